"""Functions that NumPy lacks; called like its own, with ``out``."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

_error_function = np.frompyfunc(math.erf, 1, 1)


def erf(x: Any, out: Any = None) -> Any:
    """The error function ``2/√π ∫₀ˣ exp(−t²) dt``; any shape."""
    values = _error_function(x)
    if type(x) is not np.ndarray:
        return values
    found = np.empty(x.shape) if out is None else out
    found[...] = values
    return found


FURTHER: dict[str, Callable[..., Any]] = {"erf": erf}
"""The functions by name."""
