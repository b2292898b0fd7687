"""What a command answers, for people and for machines."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from passloc_env.errors import InputError
from training.arguments import free_path
from training.commands import Asked, Output
from training.files import json_text, write_whole

_STANDARD_OUTPUT = Path("-")

_PLACES = ("out", "results")
"""What commands call the places that they write into."""


class Unmet(Exception):
    """A command did all it was asked to, and what it found is not as it has to be.

    Args:
        message: what is wrong.
        answer: what was found, to be given all the same.
    """

    def __init__(self, message: str, answer: Any) -> None:
        super().__init__(message)
        self.answer = answer


@contextmanager
def prepared(arguments: Asked) -> Iterator[None]:
    """Look whether the answer can be given as asked, before anything takes long; keep quiet meanwhile if asked to.

    Raises:
        InputError: the place is that of something else that is written.
        OSError: a place that cannot be written into.
    """
    output = arguments.output
    if output.json is not None and output.json != _STANDARD_OUTPUT:
        for name in _PLACES:
            _check_apart(output.json, name, getattr(arguments, name, None))
        free_path(output.json)
    from training.progress import console

    console.quiet = output.quiet or output.json == _STANDARD_OUTPUT
    try:
        yield
    finally:
        console.quiet = False


def _check_apart(json: Path, name: str, other: Path | None) -> None:
    """InputError when what is written elsewhere makes a folder, or another file, of the place of the answer."""
    if other is None:
        return
    place = other.resolve()
    if json.resolve() in (place, *place.parents):
        raise InputError(f"json = {str(json)!r} is not possible: {name} = {str(other)!r} is written there")


def give(output: Output, answer: Any) -> None:
    """Write the answer as JSON where that was asked for."""
    if output.json is None:
        return
    text = json_text(plain(answer))
    if output.json == _STANDARD_OUTPUT:
        sys.stdout.write(text)
    else:
        write_whole(output.json, text)


def plain(answer: Any) -> Any:
    """An answer as data that JSON knows: what was written, or what it says of itself."""
    if isinstance(answer, Path):
        return {"written": str(answer)}
    if isinstance(answer, Mapping):
        return dict(answer)
    if isinstance(answer, Sequence):
        return [plain(each) for each in answer]
    return answer.to_dict()
