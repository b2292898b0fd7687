"""Writing files that others may read, or that a run cut short may leave behind."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_SHOWN = 5
_PARTIAL = ".part"
_saved: dict[Path, str] = {}


def json_text(data: Any) -> str:
    """Plain data as JSON, with null for what is not a finite number, which JSON does not know."""
    return json.dumps(_finite(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that appears whole or not at all; text as UTF-8.

    Raises:
        OSError: it cannot be written; the message names it.
    """
    try:
        with appearing(path) as partial:
            partial.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        raise cannot_write(path, error) from None


def cannot_write(path: Path, error: OSError) -> OSError:
    """The same error with a message that names the file: what a full disk raises does not."""
    return type(error)(f"{path} cannot be written: {error.strerror or error}")


@contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """Where to write a file that is to be at ``path`` when, and only if, all has gone well.

    A link stays one, and what is no file, such as a pipe, is written into directly.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield target
        note(path)
        return
    partial = target.with_name(f".{target.stem}.{os.getpid()}{_PARTIAL}{target.suffix}")
    try:
        yield partial
        partial.replace(target)
        note(path)
    finally:
        partial.unlink(missing_ok=True)


def note(path: Path, what: str = "") -> None:
    """Remember that a file, or a folder of them, is whole: who interrupts a command is told.

    Args:
        path: where it is.
        what: what it is, in a few words; nothing where its name says it.
    """
    _saved[path] = what


def move_whole(folder: Path, to: Path) -> None:
    """Give a folder that is whole the name by which it is known from now on."""
    folder.replace(to)
    _unsay(folder)
    note(to)


@contextmanager
def unsaid(folder: Path) -> Iterator[None]:
    """Nobody is told of what appears in a folder meanwhile: it will not last."""
    try:
        yield
    finally:
        _unsay(folder)


def _unsay(folder: Path) -> None:
    for path in [path for path in _saved if folder in (path, *path.parents)]:
        del _saved[path]


def forget() -> None:
    """Begin to remember anew."""
    _saved.clear()


def saved() -> list[str]:
    """What has been saved since the last :func:`forget`; of many files the folders."""
    apart = {path: what for path, what in _saved.items() if not set(path.parents) & set(_saved)}
    if len(apart) <= _SHOWN:
        return [f"{what} in {path}" if what else str(path) for path, what in apart.items()]
    folders = dict.fromkeys(str(path.parent) for path in apart)
    counts = {folder: sum(str(path.parent) == folder for path in apart) for folder in folders}
    return [f"{count} {'file' if count == 1 else 'files'} in {folder}" for folder, count in counts.items()]


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
