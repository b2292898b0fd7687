"""What the formulas of this package refuse, in one line that names field, value and what is allowed."""

from __future__ import annotations

import math

import numpy as np

from passloc_env.arrays import Array
from passloc_env.errors import InputError


def require_positive(field: str, value: float) -> None:
    """Raise InputError unless a number is finite and above zero."""
    if not 0.0 < value < math.inf:
        raise InputError(f"{field} = {value} is not possible: must be finite and above 0")


def require_finite(field: str, values: Array) -> None:
    """Raise InputError, with the first offender, unless all values are finite."""
    offenders = values[~np.isfinite(values)]
    if offenders.size:
        raise InputError(f"{field} = {offenders[0]} is not possible: must be finite")


def require_shape(field: str, values: Array, axes: int, meaning: str) -> None:
    """Raise InputError unless an array has that many axes, none of them empty."""
    if values.ndim != axes or values.size == 0:
        raise InputError(f"{field} of shape {values.shape} is not possible: must be {meaning}, none of them empty")
