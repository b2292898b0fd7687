"""Field declarations: the vocabulary in which components say what they accept."""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from passloc_env.component import Component, Spec, from_dict
from passloc_env.distributions import Distribution
from passloc_env.errors import ScenarioError, unknown_name


@dataclass(frozen=True)
class Quantity(Spec):
    """A real number within limits, or a distribution whose support lies within them."""

    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    below: float | None = None
    infinite: bool = False
    plain: bool = False
    """Whether it is a constant of the problem that cannot be drawn."""
    appended: bool = False
    """Whether its draw comes after those of all others: what is added to a scenario shifts nobody's numbers."""

    def check(self, name: str, value: Any) -> Any:
        """A float or a distribution; numbers written as text (``3e-3`` in YAML) are read as numbers."""
        if isinstance(value, Mapping):
            value = decode(name, value, Distribution)
        if isinstance(value, Distribution) and not self.plain:
            low, high = value.support
            self._check_number(name, low, value)
            self._check_number(name, high, value)
            return value
        number = _as_float(value)
        if number is None:
            raise ScenarioError(name, value, self.allowed)
        self._check_number(name, number, value)
        return number

    def _check_number(self, name: str, number: float, value: Any) -> None:
        acceptable = (
            (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.at_most is None or number <= self.at_most)
            and (self.below is None or number < self.below)
            and not math.isnan(number)
            and (self.infinite or math.isfinite(number) or isinstance(value, Distribution))
        )
        if not acceptable:
            raise ScenarioError(name, value, self.allowed)

    @property
    def allowed(self) -> str:
        """What the field accepts, in words."""
        limits = [
            f"{word} {limit:g}"
            for word, limit in (
                ("above", self.above),
                ("at least", self.at_least),
                ("at most", self.at_most),
                ("below", self.below),
            )
            if limit is not None
        ]
        words = " and ".join(limits) if limits else ("any number" if self.infinite else "any finite number")
        unit = f" {self.unit}" if self.unit else ""
        return f"must be a plain number, {words}{unit}" if self.plain else f"must be {words}{unit}, or a distribution"


def _as_float(value: Any) -> float | None:
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return None
    if isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_)):
        return float(value)
    return None


@dataclass(frozen=True)
class Count(Spec):
    """A whole number within limits."""

    at_least: int = 0
    at_most: int | None = None

    def check(self, name: str, value: Any) -> int:
        """An int; floats that are whole are not accepted, for they usually are mistakes."""
        whole = isinstance(value, numbers.Integral) and not isinstance(value, (bool, np.bool_))
        if not whole or value < self.at_least or (self.at_most is not None and value > self.at_most):
            most = "" if self.at_most is None else f" and at most {self.at_most}"
            raise ScenarioError(name, value, f"must be a whole number of at least {self.at_least}{most}")
        return int(value)


@dataclass(frozen=True)
class Option(Spec):
    """One of a few words."""

    options: tuple[str, ...] = ()

    def check(self, name: str, value: Any) -> str:
        """The word itself."""
        if value not in self.options:
            raise unknown_name(name, value, self.options, "option")
        return str(value)


@dataclass(frozen=True)
class Flag(Spec):
    """True or false."""

    def check(self, name: str, value: Any) -> bool:
        """A bool; 0 and 1 are not accepted."""
        if not isinstance(value, (bool, np.bool_)):
            raise ScenarioError(name, value, "must be true or false")
        return bool(value)


@dataclass(frozen=True)
class Text(Spec):
    """A name, of which files and folders are called too."""

    def check(self, name: str, value: Any) -> str:
        """The text itself; nothing that a terminal would obey, or that leads elsewhere as a path."""
        if not isinstance(value, str):
            raise ScenarioError(name, value, "must be text")
        if not 0 < len(value) <= 100 or not value.isprintable() or value[0] == "." or {"/", "\\"} & set(value):
            allowed = "must be 1 to 100 printable characters without / and \\, the first no full stop"
            raise ScenarioError(name, value, allowed)
        return value


@dataclass(frozen=True)
class Vector(Spec):
    """A short list of quantities, e.g. a position by axis."""

    each: Quantity = Quantity("")

    def check(self, name: str, value: Any) -> tuple[Any, ...]:
        """A tuple of floats or distributions."""
        if isinstance(value, (str, Mapping)) or not isinstance(value, Sequence | np.ndarray):
            raise ScenarioError(name, value, "must be a list of numbers")
        return tuple(self.each.check(f"{name}.{i}", item) for i, item in enumerate(value))


@dataclass(frozen=True)
class Part(Spec):
    """Another component of a given kind."""

    kind: type[Component] = Component

    def check(self, name: str, value: Any) -> Component:
        """The component, built from plain data if need be."""
        if isinstance(value, Mapping):
            return decode(name, value, self.kind)
        if not isinstance(value, self.kind):
            raise ScenarioError(name, value, f"must be a {self.kind.__name__}")
        return value


@dataclass(frozen=True)
class Parts(Spec):
    """A list of components of a given kind."""

    kind: type[Component] = Component
    at_least: int = 0

    def check(self, name: str, value: Any) -> tuple[Component, ...]:
        """A tuple of components."""
        if isinstance(value, (str, Mapping)) or not isinstance(value, Sequence):
            raise ScenarioError(name, value, f"must be a list of {self.kind.__name__}")
        if len(value) < self.at_least:
            raise ScenarioError(name, value, f"needs at least {self.at_least} {self.kind.__name__}")
        one = Part("", kind=self.kind)
        return tuple(one.check(f"{name}.{i}", item) for i, item in enumerate(value))


def decode(name: str, data: Mapping[str, Any], kind: type[Component]) -> Component:
    """Build the component of field ``name`` from plain data and see that it is of the wanted kind."""
    try:
        component = from_dict(data, default=None if kind in _ABSTRACT else kind, kind=kind)
    except ScenarioError as error:
        raise error.inside(name) from None
    if not isinstance(component, kind):
        raise ScenarioError(name, type(component).__name__, f"must be a {kind.__name__}")
    return component


_ABSTRACT: set[type[Component]] = {Distribution}


def abstract(kind: type[Any]) -> type[Any]:
    """Class decorator: components of this kind must name their type, for there is none by default."""
    _ABSTRACT.add(kind)
    return kind


def _field(spec: Spec, default: Any) -> Any:
    return dataclasses.field(default=default, metadata={"spec": spec})


def quantity(doc: str, default: Any = dataclasses.MISSING, *, unit: str = "", **limits: Any) -> Any:
    """Declare a real-number field; ``limits`` are those of :class:`Quantity`."""
    return _field(Quantity(doc, unit, **limits), default)


def vector(doc: str, default: Any = dataclasses.MISSING, *, unit: str = "", **limits: Any) -> Any:
    """Declare a field holding a few real numbers."""
    return _field(Vector(doc, unit, each=Quantity(doc, unit, **limits)), default)


def count(doc: str, default: Any = dataclasses.MISSING, *, at_least: int = 0, at_most: int | None = None) -> Any:
    """Declare a whole-number field."""
    return _field(Count(doc, at_least=at_least, at_most=at_most), default)


def option(doc: str, default: str, options: tuple[str, ...]) -> Any:
    """Declare a field holding one of a few words."""
    return _field(Option(doc, options=options), default)


def flag(doc: str, default: bool) -> Any:
    """Declare a true-or-false field."""
    return _field(Flag(doc), default)


def text(doc: str, default: str) -> Any:
    """Declare a field that holds a name."""
    return _field(Text(doc), default)


def part(kind: type[Component], doc: str, default: Any = dataclasses.MISSING) -> Any:
    """Declare a field holding another component."""
    return _field(Part(doc, kind=kind), default)


def parts(kind: type[Component], doc: str, default: Any = dataclasses.MISSING, *, at_least: int = 0) -> Any:
    """Declare a field holding a list of components."""
    return _field(Parts(doc, kind=kind, at_least=at_least), default)
