"""Checking actions at the door."""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array
from passloc_env.errors import ActionError


def finite_actions(actions: object, shape: tuple[int, ...]) -> Array:
    """Actions as float64 of the given shape; ActionError, in one line, for anything that cannot be flown."""
    try:
        array = np.asarray(actions)
    except ValueError:
        raise ActionError(f"actions must have shape {shape}, got a ragged sequence") from None
    if array.dtype.kind not in "fiu":
        raise ActionError(f"actions must be real numbers of shape {shape}, got {array.dtype}")
    if array.shape != shape:
        raise ActionError(f"actions have shape {array.shape}, expected {shape}")
    checked = array.astype(np.float64)
    if not np.isfinite(checked).all():
        bad = sorted({int(index) for index in np.argwhere(~np.isfinite(checked))[:, 0]})
        raise ActionError(f"actions {bad[:8]} are NaN or infinite")
    return checked
