"""Reading what users type: scenarios and overrides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from passloc_env.errors import InputError, ScenarioError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find

_PICTURES = (".png", ".svg", ".pdf", ".jpg")
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


def check_seed(seed: int) -> None:
    """InputError for a negative seed."""
    if seed < 0:
        raise InputError(f"seed = {seed} is not possible: must be at least 0")


def picture_path(path: Path) -> Path:
    """The path of a picture to write, checked like any other and to end as a picture does.

    Raises:
        InputError: another ending.
    """
    if path.suffix.lower() not in _PICTURES and not path.is_dir():
        raise InputError(f"out = {str(path)!r} is not possible: must end in {', '.join(_PICTURES)}")
    return free_path(path)


def free_path(path: Path) -> Path:
    """The path of a file to write, checked to lie in a folder that exists.

    Raises:
        FileNotFoundError: no such folder.
        IsADirectoryError: the path is a folder itself.
    """
    if not path.resolve().parent.is_dir():
        raise FileNotFoundError(f"{path.parent} is not a folder")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder: name a file")
    return path


def new_folder(wanted: Path | None, name: str) -> Path:
    """Make a run folder, ``runs/NAME`` by default, numbered when that exists; nothing is ever written over.

    Raises:
        FileExistsError: the wanted folder is not empty, or is a file.
    """
    if wanted is not None:
        if wanted.exists() and (not wanted.is_dir() or any(wanted.iterdir())):
            raise FileExistsError(f"{wanted} is not an empty folder: name another one with --out")
        wanted.mkdir(parents=True, exist_ok=True)
        return wanted
    number = 0
    while True:
        folder = Path("runs") / (name if number == 0 else f"{name}.{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        else:
            return folder
