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


def rows(first: Array, *others: Array) -> Array:
    """Equally shaped arrays as the rows of a new one; ``np.stack`` without its checks."""
    stacked = np.empty((1 + len(others), *first.shape))
    stacked[0] = first
    for index, row in enumerate(others, 1):
        stacked[index] = row
    return stacked
