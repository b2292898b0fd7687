"""The correction that all Kalman filters share, however they came by their moments."""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array, BoolArray
from passloc_env.linalg import (
    cholesky_above,
    mend,
    row_gram,
    solve_lower,
    transpose,
    tree_sum,
)
from passloc_env.tracking.tracker import Track


def correct(
    track: Track, right: Array, innovation_covariance: Array, floors: Array, detected: BoolArray | None = None
) -> None:
    """``K = Pxz S⁻¹``, ``x ← x + K y``, ``P ← P − K S Kᵀ``, in place and without an inverse.

    Args:
        track: whose mean, covariance and ``nis`` are corrected.
        right: ``[Pxzᵀ | y]``, the cross covariance ``(m, n, N)`` and behind it the innovation; overwritten.
        innovation_covariance: ``S (m, m, N)``; overwritten.
        floors: what its pivots are known to be at least ``(m, 1|N)``: those of the measurement noise.
        detected: which scalars ``(m, N)`` were measured; None means all.
    """
    n = len(track.mean)
    if detected is not None:
        _ignore_missing(right, innovation_covariance, detected)
    lower = cholesky_above(innovation_covariance, floors)
    whitened = solve_lower(lower, right)
    gain, residual = whitened[:, :n], whitened[:, n]
    track.mean += tree_sum(gain * residual[:, None])
    track.covariance -= row_gram(transpose(gain))
    track.nis[...] = tree_sum(residual * residual)


def repair(track: Track) -> None:
    """Make covariances that rounding has spoilt positive definite again, and count it."""
    # What is not finite stays so: the innovation will show it, and the simulation begins that track anew.
    track.repairs[mend(track.covariance)] += 1


def _ignore_missing(right: Array, covariance: Array, detected: BoolArray) -> None:
    """Make undetected scalars carry no information: no innovation, no gain, unit variance of their own."""
    missing = ~detected
    right[np.broadcast_to(missing[:, None], right.shape)] = 0.0
    covariance[missing[:, None] | missing[None]] = 0.0
    for row in range(len(covariance)):
        covariance[row, row, missing[row]] = 1.0
