"""Reading what users type: overrides, and the places where they want results."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from passloc_env.errors import InputError, ScenarioError
from passloc_env.reading import yaml_data

_PROBE = 1 << 12
"""Bytes that a folder must have room for."""

_PICTURES = (".png", ".svg", ".pdf", ".jpg")


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
            overrides[name] = yaml_data(value)
        except InputError:
            raise ScenarioError(name, value, "is not readable YAML") from None
    return overrides


def check_seed(seed: int) -> None:
    """InputError for a negative seed."""
    if seed < 0:
        raise InputError(f"seed = {seed} is not possible: must be at least 0")


def at_least_one(**counts: int) -> None:
    """InputError for the first of the named counts that is below one."""
    for name, count in counts.items():
        if count < 1:
            raise InputError(f"{name} = {count} is not possible: must be at least 1")


def picture_path(path: Path) -> Path:
    """The path of a picture to write, checked like any other and to end as a picture does.

    Raises:
        InputError: another ending.
    """
    if path.suffix.lower() not in _PICTURES and not path.is_dir():
        raise InputError(f"out = {str(path)!r} is not possible: must end in {', '.join(_PICTURES)}")
    return free_path(path)


def free_path(path: Path) -> Path:
    """The path of a file to write, in a folder that is made if need be and that can be written into.

    Raises:
        IsADirectoryError: the path is a folder itself.
        OSError: as :func:`writable_folder`.
    """
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder: name a file")
    writable_folder(path.parent)
    return path


def writable_folder(path: Path) -> Path:
    """A folder to write into, made with its parents if need be; a file was written there and taken away again.

    Whatever takes long asks for its folder first: a result that cannot be saved is a result lost.

    Raises:
        NotADirectoryError: a file stands in the way.
        OSError: the folder cannot be made or written into.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path) as file:
            file.write(bytes(_PROBE))
    except (FileExistsError, NotADirectoryError):
        raise NotADirectoryError(f"{path} is not a folder") from None
    except OSError as error:
        raise type(error)(f"{path} cannot be written into: {error.strerror}") from None
    return path


def new_folder(wanted: Path | None, name: str) -> Path:
    """Make a run folder, ``runs/NAME`` by default, numbered when that exists; nothing is ever written over.

    Raises:
        FileExistsError: the wanted folder is not empty, or is a file.
        OSError: as :func:`writable_folder`.
    """
    if wanted is not None:
        if wanted.exists() and (not wanted.is_dir() or any(wanted.iterdir())):
            raise FileExistsError(f"{wanted} is not an empty folder: name another one with --out")
        return writable_folder(wanted)
    writable_folder(Path("runs"))
    number = 0
    while True:
        folder = Path("runs") / (name if number == 0 else f"{name}.{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder


def kept_folder(wanted: Path) -> Path:
    """Make the folder of something that goes on where it stopped, unless it is there.

    Raises:
        FileExistsError: the folder, or one above it, is a file.
    """
    try:
        wanted.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise FileExistsError(f"{wanted} is not a folder: name another one with --out") from None
    return wanted


def file_stem(*words: object) -> str:
    """Words as the stem of a file's name, with - for whatever some system does not allow there."""
    return re.sub(r"[^\w.=+-]+", "-", "-".join(map(str, words)), flags=re.ASCII).strip("-.")
