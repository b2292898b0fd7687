"""The array types of the package: float64, batch axis last."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers, shape ``(…, N)``: the last axis runs over the environments of a batch."""

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

Number = Any
"""A scenario quantity: a float, a ``Distribution`` sampled at each reset, or (once realised) an array ``(N,)``."""


def blank(like: Array, shape: tuple[int, ...]) -> Array:
    """A new array of the kind of another one, to be filled.

    Whatever runs inside a step makes its arrays from those it is given: then it runs on symbols too.
    """
    return np.empty_like(like, shape=shape)


def zeros(like: Array, shape: tuple[int, ...]) -> Array:
    """A new array of the kind of another one, all zero; see :func:`blank`."""
    return np.zeros_like(like, shape=shape)


def zeros_for(shape: tuple[int, ...], *values: Number) -> Array:
    """Zeros that can hold these values, which may be plain numbers; see :func:`blank`."""
    special = [value for value in values if isinstance(value, np.ndarray) and type(value) is not np.ndarray]
    return zeros(special[0], shape) if special else np.zeros(shape)


def numbers(quantity: Number) -> Array:
    """A realised quantity as an array ``(1|N,)``."""
    return np.atleast_1d(quantity if isinstance(quantity, np.ndarray) else np.asarray(quantity, float))


def rows(first: Array, *others: Array) -> Array:
    """Equally shaped arrays as the rows of a new one; ``np.stack`` without its checks."""
    stacked = blank(first, (1 + len(others), *first.shape))
    stacked[0] = first
    for index, row in enumerate(others, 1):
        stacked[index] = row
    return stacked
