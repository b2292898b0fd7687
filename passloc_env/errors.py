"""Errors that help: one line with the field, the value, what is allowed and the closest valid name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_SHOWN = 200
"""Characters of a value or a name that a message shows at most."""


def shown(value: object) -> str:
    """A value as messages show it: in one line, and of a long one the beginning."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} …"


def one_line(reason: object) -> str:
    """What somebody else's error says, as the end of a line of ours."""
    text = " ".join(str(reason).split())
    text = text if text.isprintable() else repr(text)[1:-1]
    return text if len(text) <= 2 * _SHOWN else f"{text[: 2 * _SHOWN]} …"


class InputError(ValueError):
    """What somebody gave cannot be used; the message is one line that says why and what would do."""


class ScenarioError(InputError):
    """A scenario says something impossible.

    Attributes:
        field: dotted name of the offending field, e.g. ``sensors.0.sigma``.
        value: the value that was given.
        allowed: what would have been accepted, in words.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        self.field, self.value, self.allowed = field, value, allowed
        name = field if field.isprintable() and len(field) <= _SHOWN else shown(field)
        super().__init__(f"{name} = {shown(value)} is not possible: {allowed}")

    def inside(self, prefix: str) -> ScenarioError:
        """The same error seen from the enclosing component."""
        return ScenarioError(f"{prefix}.{self.field}" if self.field else prefix, self.value, self.allowed)


def closest(name: str, known: Iterable[str]) -> str | None:
    """The known name that somebody may have meant; None when none is like it."""
    return next(iter(difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)), None)


def unknown_name(field: str, value: object, valid: Iterable[str], noun: str, name: object = None) -> ScenarioError:
    """The error for a name that does not exist, with the closest one that does.

    Args:
        field: dotted name of where it was found.
        value: what was given there.
        valid: the names that exist.
        noun: what they name.
        name: the unknown name, when it is not the value itself.
    """
    valid = sorted(valid)
    close = closest(str(value if name is None else name), valid)
    hint = "" if close is None else f"did you mean {close!r}? "
    return ScenarioError(field, value, f"no such {noun}; {hint}known: {', '.join(valid)}")


class ActionError(InputError):
    """An action that cannot be flown; nothing has changed when it is raised."""


class WorkerError(RuntimeError):
    """A process that did part of the work is gone, or could not do it."""


class RenderError(RuntimeError):
    """A picture cannot be shown."""


class NotResetError(RuntimeError):
    """A step was asked for before the first reset."""
