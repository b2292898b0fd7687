"""The engine that is none: this process does one task after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from training.engines.interface import Result


class Alone:
    """See :class:`training.engines.interface.Engine`; what a task raises is raised as it is."""

    workers = 1
    sees_files = True

    def map(self, function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Result]]:
        """One call after the other, each when it is asked for."""
        for index, arguments in enumerate(tasks):
            yield index, function(*arguments)


ALONE = Alone()
