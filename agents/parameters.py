"""What rules and planners can be told: declared where their builders take it, read by commands, errors and pages.

A builder annotates what it can be told, ``angle: Annotated[float, Number("…", "degrees", -180.0, 180.0)] = 60.0``, and
what it hands on, ``**others: Annotated[Any, builder]``.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, get_type_hints


@dataclass(frozen=True)
class Number:
    """A parameter that is a number.

    Args:
        meaning: of it, in a line.
        unit: what it is counted in; empty for bare numbers.
        least: what it must not be less than.
        most: what it must not be more than.
        above: whether it must be more than the least.
        whole: whether it must be a whole number.
        endless: whether it may be infinite.
        by_default: what it is by default, in words, where that depends on the scenario.
    """

    meaning: str
    unit: str = ""
    least: float = 0.0
    most: float = math.inf
    above: bool = False
    whole: bool = False
    endless: bool = False
    by_default: str = ""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        bounded = math.isfinite(self.most)
        kind = "a whole number" if self.whole else "a number" if bounded or self.endless else "a finite number"
        if bounded:
            return f"{kind} from {self.least:g} to {self.most:g}"
        return f"{kind} above {self.least:g}" if self.above else f"{kind} of at least {self.least:g}"

    def read(self, name: str, text: str) -> float:
        """The number that a text means; ValueError unless it is allowed."""
        try:
            value = float(text)
        except ValueError:
            raise ValueError(f"'{name}={text}' must be name=number") from None
        inside = self.least < value <= self.most if self.above else self.least <= value <= self.most
        finite = math.isfinite(value) or (self.endless and not self.whole)
        if not inside or not finite or (self.whole and value != int(value)):
            raise ValueError(f"{name} must be {self.allowed}")
        return int(value) if self.whole else value


@dataclass(frozen=True)
class Word:
    """A parameter that is one of some words.

    Args:
        meaning: of it, in a line.
        words: those allowed.
    """

    meaning: str
    words: tuple[str, ...]
    unit: str = ""
    by_default: str = ""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"one of {', '.join(self.words)}"

    def read(self, name: str, text: str) -> str:
        """The word; ValueError unless it is allowed."""
        if text not in self.words:
            raise ValueError(f"{name} must be {self.allowed}")
        return text


class Parameter(NamedTuple):
    """What a builder can be told, and what it does unless it is told."""

    kind: Number | Word
    default: Any

    @property
    def shown(self) -> str:
        """The default as it is written, or in words where it depends on the scenario."""
        if self.kind.by_default:
            return self.kind.by_default
        return self.default if isinstance(self.default, str) else f"{self.default:g}"


def declared(builder: Callable[..., Any]) -> dict[str, Parameter]:
    """Everything that a builder can be told, by name, in order."""
    hints = get_type_hints(builder, include_extras=True)
    found: dict[str, Parameter] = {}
    for name, parameter in inspect.signature(builder).parameters.items():
        for note in getattr(hints.get(name), "__metadata__", ()):
            if isinstance(note, (Number, Word)):
                found[name] = Parameter(note, parameter.default)
            else:
                found |= declared(note)
    return found
