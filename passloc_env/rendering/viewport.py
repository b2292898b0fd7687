"""From metres to pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array

_NICE = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
_MARGIN = 1.1
_SMALLEST = 10.0
"""Half the height of what is shown at least, m."""


@dataclass(frozen=True)
class Viewport:
    """A map of so many pixels.

    Attributes:
        centre: what is in the middle ``(2,)``, m.
        scale: metres per pixel.
        left, top, width, height: where the map is, in pixels.
    """

    centre: Array
    scale: float
    left: int
    top: int
    width: int
    height: int

    @classmethod
    def around(cls, points: Array, left: int, top: int, width: int, height: int) -> Viewport:
        """A map that shows all of the points ``(k, 2)``; it moves and grows by jumps, not by trembling."""
        finite = points[np.isfinite(points).all(axis=1)]
        low, high = (finite.min(axis=0), finite.max(axis=0)) if len(finite) else (np.zeros(2), np.zeros(2))
        grid = 0.25 * nice(max(float((high - low).max()), _SMALLEST))
        centre = grid * np.rint(0.5 * (low + high) / grid)
        reach = np.maximum(high - centre, centre - low) * _MARGIN
        half = nice(max(float(reach[1]), float(reach[0]) * height / width, _SMALLEST))
        return cls(centre, 2.0 * half / height, left, top, width, height)

    def pixels(self, points: Array) -> Array:
        """Pixels ``(…, 2)`` of points ``(…, 2)``, east to the right and north upwards."""
        middle = np.array([self.left + 0.5 * self.width, self.top + 0.5 * self.height])
        shown: Array = middle + (points - self.centre) * np.array([1.0, -1.0]) / self.scale
        return shown

    @property
    def bar(self) -> float:
        """A round length of about a fifth of the width, m."""
        return round_down(0.25 * self.width * self.scale)


def nice(length: float) -> float:
    """The next longer length of a few round ones per decade."""
    decade = 10.0 ** math.floor(math.log10(length))
    return next(step * decade for step in (*_NICE, 20.0) if step * decade >= length * (1.0 - 1e-9))


def round_down(length: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that is not longer."""
    decade = 10.0 ** math.floor(math.log10(length) + 1e-9)
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= length * (1.0 + 1e-9))


def in_words(length: float) -> str:
    """A length with its unit."""
    return f"{length / 1e3:g} km" if length >= 1e3 else f"{length:g} m"
