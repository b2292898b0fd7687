"""Reading what users type: scenarios and overrides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from passloc_env.errors import ScenarioError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find

_FILES = (".yaml", ".yml", ".json")


def read_scenario(text: str) -> Scenario:
    """A scenario from its name, Gymnasium id, or file.

    Raises:
        ScenarioError: no such scenario or unreadable file, with the closest name.
    """
    if not text.endswith(_FILES):
        return find(text)
    try:
        return Scenario.from_file(text)
    except OSError as error:
        raise ScenarioError("scenario", text, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ScenarioError("scenario", text, "is not a text file") from None


def parse_overrides(settings: Sequence[str]) -> dict[str, Any]:
    """Overrides from ``dotted.name=value`` words; values are read as YAML.

    Raises:
        ScenarioError: a word without ``=`` or a value that is not YAML.
    """
    overrides: dict[str, Any] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or not name:
            raise ScenarioError("override", setting, "must be dotted.name=value")
        try:
            overrides[name] = yaml.safe_load(value)
        except yaml.YAMLError:
            raise ScenarioError(name, value, "is not readable YAML") from None
    return overrides


def free_path(path: Path) -> Path:
    """The path itself, checked to lie in a folder that exists."""
    if not path.resolve().parent.is_dir():
        raise FileNotFoundError(f"{path.parent} is not a folder")
    return path
