"""What formulas refuse, in one line that names field, value and what is allowed; each check returns what it accepts."""

from __future__ import annotations

import math
import numbers

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array
from passloc_env.errors import InputError

_REAL = "biuf"
"""Kinds of NumPy types that are real numbers; text that reads like a number is none."""


def as_floats(field: str, values: ArrayLike) -> Array:
    """Real numbers of any shape, lists of them too, as an array.

    Raises:
        InputError: text, ragged lists, complex numbers and other things that are no real numbers.
    """
    try:
        given = np.asarray(values)
    except ValueError:
        raise InputError(f"{field} is not possible: must be numbers in rows of equal length") from None
    if given.dtype.kind not in _REAL:
        shown = " ".join(repr(values).split())
        raise InputError(f"{field} = {shown[:40]} is not possible: must be real numbers")
    return np.asarray(given, np.float64)


def require_finite(field: str, values: ArrayLike) -> Array:
    """The values as an array; InputError, with the first offender, unless all are finite."""
    array = as_floats(field, values)
    offenders = array[~np.isfinite(array)]
    if offenders.size:
        raise InputError(f"{field} = {offenders[0]} is not possible: must be finite")
    return array


def require_shape(field: str, values: ArrayLike, axes: int, meaning: str) -> Array:
    """The values as an array; InputError unless it has that many axes, none of them empty, and finite values."""
    array = as_floats(field, values)
    if array.ndim != axes or array.size == 0:
        raise InputError(f"{field} of shape {array.shape} is not possible: must be {meaning}, none of them empty")
    return require_finite(field, array)


def require_exactly(field: str, values: ArrayLike, *shapes: tuple[int, ...]) -> Array:
    """The values as an array; InputError unless it has one of the shapes, and finite values."""
    array = as_floats(field, values)
    if array.shape not in shapes:
        allowed = " or ".join(str(shape) for shape in dict.fromkeys(shapes))
        raise InputError(f"{field} of shape {array.shape} is not possible: must be {allowed}")
    return require_finite(field, array)


def require_positive(field: str, value: float) -> None:
    """Raise InputError unless a value is one number, finite and above zero."""
    if as_floats(field, value).ndim or not 0.0 < value < math.inf:
        raise InputError(f"{field} = {value} is not possible: must be finite and above 0")


def require_count(field: str, value: int, at_least: int) -> None:
    """Raise InputError unless a value is a whole number of at least so many."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < at_least:
        raise InputError(f"{field} = {value} is not possible: must be at least {at_least}, a whole number")
