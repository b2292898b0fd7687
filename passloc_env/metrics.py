"""How well an emitter is localised; shapes ``(N,)`` unless said otherwise."""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array, BoolArray
from passloc_env.linalg import cholesky, diagonal, inner, mend, solve_lower, tree_sum

LOST_ERROR = 1.0
"""A track whose relative range error ends above this is lost."""

LOST_NEES = 100.0
"""A track whose NEES ends above this is lost."""


def relative_range_error(position_error: Array, true_range: Array) -> Array:
    """``‖p̂ − p‖ / r`` for errors ``(d, N)`` (paper 000, eq. 26)."""
    error: Array = np.sqrt(inner(position_error, position_error)) / true_range
    return error


def log_range_bound(range_sigma: Array, true_range: Array) -> Array:
    """``ln(σ_r / r)``, the headline: how well the range could be known along the path flown."""
    logarithm: Array = np.log(range_sigma / true_range)
    return logarithm


def root_trace(covariance: Array, block: slice) -> Array:
    """Root of the trace of a block of ``(n, n, N)``: the root mean square length of errors in those states ``(N,)``."""
    root: Array = np.sqrt(tree_sum(diagonal(covariance)[block].copy()))
    return root


def nees(error: Array, covariance: Array) -> Array:
    """Normalised estimation error squared ``eᵀ P⁻¹ e`` for ``(n, N)``, ``(n, n, N)``; n on average when consistent.

    Covariances that rounding has spoilt count as the nearest positive definite ones.
    """
    lower, sound = cholesky(covariance)
    if not sound:
        mended = covariance.copy()
        mend(mended)
        lower, _ = cholesky(mended)
    whitened = solve_lower(lower, error[:, None].copy())[:, 0]
    return inner(whitened, whitened)


def lost(final_relative_error: Array, final_nees: Array) -> BoolArray:
    """Whether a track ended lost; comparisons are written so that a NaN counts as lost."""
    kept: BoolArray = (final_relative_error <= LOST_ERROR) & (final_nees <= LOST_NEES)
    return ~kept


def time_to(level: float, errors: Array, period: float, hold: float = 10.0) -> Array:
    """First time from which the error stays at or below ``level`` for ``hold`` seconds; the full length when never.

    Args:
        level: relative error, e.g. 0.1.
        errors: error histories ``(steps, N)``; row k is at time ``(k + 1) · period``.
        period: seconds per step.
        hold: how long it must stay below, s; cut short by the end of the episode it does not count.
    """
    steps = len(errors)
    window = max(1, round(hold / period))
    below = np.cumsum(np.concatenate([np.zeros((1, errors.shape[1])), errors <= level]), axis=0)
    result = np.full(errors.shape[1], steps * period)
    if steps >= window:
        sustained = below[window:] - below[:-window] == window
        found = sustained.any(axis=0)
        result[found] = (sustained.argmax(axis=0)[found] + 1) * period
    return result
