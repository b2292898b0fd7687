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


_LINE = 8
"""Numbers in a line of a processor's cache."""

_FEW = 64
"""Numbers in a row below which the way rows lie makes no difference."""


def row_length(numbers: int) -> int:
    """How far apart rows of so many numbers should lie: an odd number of cache lines.

    Rows a power of two apart would share a few places of the cache, and push each other out of it.
    """
    lines = -(-numbers // _LINE)
    return numbers if numbers < _FEW else _LINE * (lines + 1 - lines % 2)


def lasting(shape: tuple[int, ...]) -> Array:
    """Zeros ``(…, N)`` for numbers that every step reads and writes; see :func:`row_length`."""
    return np.zeros((*shape[:-1], row_length(shape[-1])))[..., : shape[-1]]


def lasting_copy(values: Array) -> Array:
    """A copy of numbers ``(…, N)`` for every step to read and write; see :func:`row_length`."""
    copied = lasting(values.shape)
    copied[...] = values
    return copied


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
