"""Angles and the bearing convention.

Bearings, headings and courses are compass angles: radians, clockwise from north (+y), so that
``bearing = atan2(x, y)`` and the unit vector towards it is ``(sin, cos)``. Rates follow: positive turns to starboard.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from passloc_env.arrays import Array, rows

TURN = 2.0 * math.pi


def wrap(angle: Any) -> Any:
    """The same angle in ``[-π, π]``; any shape, radians."""
    return angle - TURN * np.rint(angle * (1.0 / TURN))


def wrap_in_place(angle: Array) -> None:
    """Wrap ``angle`` to ``[-π, π]`` where it stands, with the formula of :func:`wrap`."""
    turns = angle * (1.0 / TURN)
    np.rint(turns, out=turns)
    turns *= TURN
    angle -= turns


def bearing_of(vector: Array) -> Array:
    """Compass bearing of a vector whose first two rows are east and north; ``(d, …, N)`` to ``(…, N)``."""
    bearing: Array = np.arctan2(vector[0], vector[1])
    return bearing


def direction(bearing: Any) -> Array:
    """Unit vector ``(2, …, N)`` towards a compass bearing."""
    return rows(np.sin(bearing), np.cos(bearing))


def sine_cosine(angle: Any) -> tuple[Any, Any]:
    """Sine and cosine of an angle; any shape, radians.

    With the tangent ``t`` of half the angle they are ``2t/(1 + t²)`` and ``(1 − t²)/(1 + t²)``: where NumPy has the
    processor work on many numbers at once, one tangent costs a sixth of a sine and a cosine.
    """
    tangent = np.tan(0.5 * angle)
    square = tangent * tangent
    scale = 1.0 / (1.0 + square)
    return 2.0 * tangent * scale, (1.0 - square) * scale


def turned(vector: Array, sine: Any, cosine: Any) -> Array:
    """A planar vector ``(2, N)`` turned to starboard by the angle of the given sine and cosine."""
    return rows(cosine * vector[0] + sine * vector[1], cosine * vector[1] - sine * vector[0])
