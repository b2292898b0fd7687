"""Distributions: what a scenario quantity may be instead of a number, sampled anew at every reset.

Each consumes exactly one standard uniform draw per environment, so that changing one quantity never shifts another's
random numbers.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from passloc_env.arrays import Array, Number, zeros
from passloc_env.component import Component, Spec
from passloc_env.errors import ScenarioError


@dataclass(frozen=True)
class _Plain(Spec):
    """A finite float, or a list of them."""

    many: bool = False

    def check(self, name: str, value: Any) -> Any:
        items = value if self.many and isinstance(value, (list, tuple)) else [value]
        try:
            numbers = tuple(float(item) for item in items if not isinstance(item, bool))
        except (TypeError, ValueError):
            numbers = ()
        if len(numbers) != len(items) or not numbers or not all(math.isfinite(n) for n in numbers):
            raise ScenarioError(name, value, "must be finite numbers" if self.many else "must be a finite number")
        return numbers if self.many else numbers[0]


@dataclass(frozen=True)
class _Sign(Spec):
    def check(self, name: str, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ScenarioError(name, value, "must be true or false")
        return value


def _plain(doc: str, many: bool = False) -> Any:
    return dataclasses.field(metadata={"spec": _Plain(doc, many=many)})


class Distribution(Component):
    """A random quantity: maps uniform draws to values."""

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""
        raise AssertionError(f"{type(self).__name__} must define support")

    def sample(self, uniform: Array) -> Array:
        """Values ``(N,)`` for standard uniform draws ``(N,)`` in [0, 1)."""
        raise AssertionError(f"{type(self).__name__} must define sample")


def extremes(value: Number) -> tuple[float, float]:
    """Smallest and largest value that a scenario quantity can take, a number or a distribution."""
    return value.support if isinstance(value, Distribution) else (value, value)


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform between two limits, of either sign when asked."""

    low: float = _plain("smallest value")
    high: float = _plain("largest value")
    either_sign: bool = dataclasses.field(default=False, metadata={"spec": _Sign("negate half of the draws")})

    def validate(self) -> None:
        """Limits must be in order."""
        if self.low > self.high:
            raise ScenarioError("high", self.high, f"must be at least low = {self.low:g}")

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""
        extreme = max(abs(self.low), abs(self.high))
        return (-extreme, extreme) if self.either_sign else (self.low, self.high)

    def sample(self, uniform: Array) -> Array:
        """Values ``(N,)`` for standard uniform draws ``(N,)``."""
        if not self.either_sign:
            return self.low + (self.high - self.low) * uniform
        doubled = 2.0 * uniform
        negative = doubled >= 1.0
        magnitude = self.low + (self.high - self.low) * (doubled - negative)
        return np.where(negative, -magnitude, magnitude)


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Uniform in the logarithm, for scales such as noise levels and ranges."""

    low: float = _plain("smallest value")
    high: float = _plain("largest value")

    def validate(self) -> None:
        """Limits must be positive and in order."""
        if self.low <= 0.0:
            raise ScenarioError("low", self.low, "must be above 0")
        if self.low > self.high:
            raise ScenarioError("high", self.high, f"must be at least low = {self.low:g}")

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""
        return self.low, self.high

    def sample(self, uniform: Array) -> Array:
        """Values ``(N,)`` for standard uniform draws ``(N,)``."""
        values: Array = self.low * np.exp(math.log(self.high / self.low) * uniform)
        return np.minimum(np.maximum(values, self.low), self.high)


@dataclass(frozen=True)
class Choice(Distribution):
    """One of a few values, all equally likely."""

    values: tuple[float, ...] = _plain("the values to choose from", many=True)

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""
        return min(self.values), max(self.values)

    def sample(self, uniform: Array) -> Array:
        """Values ``(N,)`` for standard uniform draws ``(N,)``."""
        scaled = uniform * len(self.values)
        chosen: Array = zeros(uniform, uniform.shape) + self.values[0]
        for index, value in enumerate(self.values[1:], 1):
            chosen = np.where(scaled >= index, value, chosen)
        return chosen
