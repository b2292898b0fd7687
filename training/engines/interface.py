"""What every engine does: independent tasks, each a function's name and plain data, done in any order, anywhere."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

from passloc_env.errors import InputError, WorkerError

Result = TypeVar("Result")

ATTEMPTS = 3
"""How often a task is begun whose worker dies, before the run is given up."""


class Engine(Protocol):
    """Where tasks are done. What a task comes to depends on its arguments alone, so all engines come to the same."""

    @property
    def workers(self) -> int:
        """How many tasks are done at once."""
        ...

    @property
    def sees_files(self) -> bool:
        """Whether tasks see the files of this machine."""
        ...

    def map(self, function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Result]]:
        """Call a function once for each task; each task's number and result, in the order in which they are done.

        Whoever stops asking ends the tasks under way; no result is given twice.

        Args:
            function: one that a module holds by name, since other processes import it.
            tasks: the arguments of each call, plain data or what can be pickled.

        Raises:
            InputError: a task's own, word for word.
            WorkerError: a task failed in another process, or its workers died again and again.
        """
        ...


class Outcome(NamedTuple):
    """What a call in another process came to, as plain data: exceptions need not survive being pickled.

    Attributes:
        value: what was returned.
        refusal: the line of an :class:`InputError`, if one was raised.
        failure: the line of any other exception.
        details: its traceback.
    """

    value: Any = None
    refusal: str = ""
    failure: str = ""
    details: str = ""

    def result(self) -> Any:
        """What was returned.

        Raises:
            InputError: the call's own.
            WorkerError: it failed otherwise; the traceback is a note on the error.
        """
        if self.refusal:
            raise InputError(self.refusal)
        if self.failure:
            error = WorkerError(f"a task failed: {self.failure}")
            error.add_note(self.details)
            raise error
        return self.value


def outcome(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Outcome:
    """Call a function, whatever comes of it."""
    try:
        return Outcome(function(*arguments))
    except InputError as error:
        return Outcome(refusal=str(error))
    except Exception as error:
        line = str(error).partition("\n")[0]
        return Outcome(failure=f"{type(error).__name__}: {line}", details=traceback.format_exc())
