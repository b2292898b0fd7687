"""What a command answers, for people and for machines."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from training.arguments import free_path
from training.commands import Output
from training.files import json_text, write_whole

_STANDARD_OUTPUT = Path("-")


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
def prepared(output: Output) -> Iterator[None]:
    """Look whether the answer can be given as asked, before anything takes long; keep quiet meanwhile if asked to.

    Raises:
        OSError: a place that cannot be written into.
    """
    if output.json is not None and output.json != _STANDARD_OUTPUT:
        free_path(output.json)
    from training.progress import console

    console.quiet = output.quiet or output.json == _STANDARD_OUTPUT
    try:
        yield
    finally:
        console.quiet = False


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
