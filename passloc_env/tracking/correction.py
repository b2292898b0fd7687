"""The correction that all Kalman filters share, however they came by their moments."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.linalg import (
    cholesky_above,
    log_determinant,
    mend,
    row_gram,
    solve_lower,
    spaced,
    transpose,
    tree_sum,
)


class Gaussian(Protocol):
    """What a filter works on in place: one belief per environment (a track), or several (a mixture's members).

    Attributes:
        mean: ``(n, …, N)``.
        covariance: ``(n, n, …, N)``.
        nis: normalised innovation squared of the last correction ``(…, N)``.
        repairs: how often each covariance had to be repaired ``(…, N)``.
    """

    mean: Array
    covariance: Array
    nis: Array
    repairs: IntArray


def correct(
    belief: Gaussian, right: Array, innovation_covariance: Array, floors: Array, detected: BoolArray | None = None
) -> Array:
    """``K = Pxz S⁻¹``, ``x ← x + K y``, ``P ← P − K S Kᵀ``, in place and without an inverse.

    Args:
        belief: whose mean, covariance and ``nis`` are corrected.
        right: ``[Pxzᵀ | y]``, the cross covariance ``(m, n, …, N)`` and behind it the innovation; overwritten.
        innovation_covariance: ``S (m, m, …, N)``; overwritten.
        floors: what its pivots are known to be at least ``(m, 1|N)``: those of the measurement noise.
        detected: which scalars ``(m, N)`` were measured; None means all.

    Returns:
        The Cholesky factor of ``S (m, m, …, N)``, rubbish above its diagonal, for :func:`log_likelihood`.
    """
    n = len(belief.mean)
    if detected is not None:
        _ignore_missing(right, innovation_covariance, spaced(detected, right.ndim - 1))
    lower = cholesky_above(innovation_covariance, spaced(floors, right.ndim - 1))
    whitened = solve_lower(lower, right)
    gain, residual = whitened[:, :n], whitened[:, n]
    belief.mean += tree_sum(gain * residual[:, None])
    belief.covariance -= row_gram(transpose(gain))
    belief.nis[...] = tree_sum(residual * residual)
    return lower


def log_likelihood(belief: Gaussian, lower: Array) -> Array:
    """``ln N(y; 0, S)`` of the innovation just absorbed ``(…, N)``, but for ``−½ ln 2π`` per scalar.

    What was not detected adds nothing. ``lower`` is what :func:`correct` has returned.
    """
    likelihood: Array = -0.5 * (belief.nis + log_determinant(lower))
    return likelihood


def repair(belief: Gaussian) -> None:
    """Make covariances that rounding has spoilt positive definite again, and count it."""
    # What is not finite stays so: the innovation will show it, and the simulation begins that track anew.
    belief.repairs[mend(belief.covariance)] += 1


def _ignore_missing(right: Array, covariance: Array, detected: BoolArray) -> None:
    """Make undetected scalars carry no information: no innovation, no gain, unit variance of their own."""
    right[...] = np.where(detected[:, None], right, 0.0)
    covariance[...] = np.where(detected[:, None] & detected[None], covariance, 0.0)
    for row in range(len(covariance)):
        covariance[row, row] = np.where(detected[row], covariance[row, row], 1.0)
