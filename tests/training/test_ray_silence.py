"""Ray, as it is started here, has been told to report nothing; a stand-in for Ray writes down what it was told."""

import importlib
import os
import sys
from types import ModuleType

import pytest

SWITCH = "RAY_USAGE_STATS_ENABLED"


@pytest.fixture
def told(monkeypatch):
    """The switch as it stood at each start of Ray."""
    found = []
    ray, exceptions = ModuleType("ray"), ModuleType("ray.exceptions")
    ray.init = lambda *arguments, **options: found.append(os.environ.get(SWITCH))
    ray.cluster_resources = lambda: {"CPU": 2.0}
    ray.remote = lambda **options: lambda function: function
    for name in ("NodeDiedError", "OutOfMemoryError", "RayError", "WorkerCrashedError"):
        setattr(exceptions, name, type(name, (Exception,), {}))
    monkeypatch.setitem(sys.modules, "ray", ray)
    monkeypatch.setitem(sys.modules, "ray.exceptions", exceptions)
    # Whatever a test sets is undone, and the engine of the true Ray, if there is one, is left alone.
    monkeypatch.setitem(sys.modules, "training.engines.ray", ModuleType("training.engines.ray"))
    monkeypatch.delitem(sys.modules, "training.engines.ray")
    monkeypatch.setenv(SWITCH, "")
    return found


def started(address=""):
    importlib.import_module("training.engines.ray").Ray(2, address)


@pytest.mark.parametrize("address", ["", "auto"])
def test_nothing_is_reported(address, told, monkeypatch):
    monkeypatch.delenv(SWITCH)
    started(address)
    assert told == ["0"]


def test_who_wants_to_report_can(told, monkeypatch):
    monkeypatch.setenv(SWITCH, "1")
    started()
    assert told == ["1"]
