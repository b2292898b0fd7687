"""What a scenario is about, in words: its story, a line of it, its sensors."""

from __future__ import annotations

import ast
import inspect
import itertools
import pkgutil
from collections import Counter
from importlib import import_module

import passloc_env.scenarios
from passloc_env.scenario import Scenario


def summary(scenario: Scenario) -> str:
    """What a scenario is about, in a line."""
    return story(scenario)[1]


def sensor_names(scenario: Scenario) -> str:
    """The kinds of sensors, with how many there are of each."""
    counts = Counter(type(sensor).__name__ for sensor in scenario.sensors)
    return ", ".join(name if count == 1 else f"{name} ×{count}" for name, count in counts.items())


def story(scenario: Scenario) -> tuple[str, str]:
    """The docstring of the file that defines the scenario, and the line below its definition."""
    for module in pkgutil.iter_modules(passloc_env.scenarios.__path__, "passloc_env.scenarios."):
        loaded = import_module(module.name)
        names = [name for name, value in vars(loaded).items() if value is scenario]
        if names:
            body = ast.parse(inspect.getsource(loaded)).body
            for statement, below in itertools.pairwise(body):
                if ast.unparse(statement).startswith(f"{names[0]} = ") and isinstance(below, ast.Expr):
                    return inspect.cleandoc(loaded.__doc__ or ""), ast.literal_eval(below.value)
    raise LookupError(f"no file defines and describes {scenario.name}")
