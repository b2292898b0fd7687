"""Triangular roots of covariances, kept up to date without ever forming the covariance.

A root carries half the digits of its square: where a covariance spans fourteen orders of magnitude, the root spans
seven. All functions work on batches, batch axis last, with sums in an order fixed by their length alone: results are
bit-equal for every batch size.
"""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array, BoolArray, blank, zeros
from passloc_env.linalg import solve_lower, transpose, tree_sum

_SMALLEST_SHARE = 1e-14
"""What a downdate leaves at least of the variance in the direction it removes; less is rounding noise."""


def triangularise(columns: Array) -> Array:
    """The lower triangular root ``L (n, n, …, N)`` with ``L Lᵀ = A Aᵀ`` of columns ``A (n, k, …, N)``.

    Its diagonal is not negative, so it is the Cholesky factor of ``A Aᵀ``, and ``Lᵀ`` the factor R of the QR
    decomposition of ``Aᵀ``. One Householder reflection for each row (Golub & Van Loan, *Matrix Computations*, 5.2):
    with ``x`` what is left of the row and ``v = x/‖x‖ ± e₁``, ``A ← A − (A v) vᵀ / |v₁|``. Never raises.
    """
    n, count = columns.shape[:2]
    rest = columns.copy()
    lower = zeros(columns, (n, n, *columns.shape[2:]))
    for j in range(min(n, count)):
        row, below = rest[j, j:], rest[j + 1 :, j:]
        length = np.sqrt(tree_sum(row * row), out=lower[j, j])
        mirror = row / np.where(length > 0.0, length, 1.0)
        sign = np.copysign(1.0, mirror[0])
        # A row of zeros needs no reflection: its mirror stays zero.
        mirror[0] += sign * (length > 0.0)
        if len(below):
            share = tree_sum(mirror[:, None] * transpose(below))
            share /= np.maximum(np.abs(mirror[0]), 1.0)
            below -= share[:, None] * mirror
            np.multiply(below[:, 0], -sign, out=lower[j + 1 :, j])
    return lower


def lower_gram(lower: Array) -> Array:
    """``L Lᵀ (n, n, …, N)`` of lower triangular matrices; symmetric to the last bit."""
    product = zeros(lower, lower.shape)
    for k in range(len(lower)):
        column = lower[k:, k]
        product[k:, k:] += column[:, None] * column
    return product


def rotate_in(leading: Array, others: Array) -> None:
    """Rotate columns into a leading one so that their first row vanishes; in place.

    Args:
        leading: ``(1 + r, …, N)``, its first entry positive. Becomes the norm of the first row, and below it what the
            rotations bring there.
        others: ``(1 + r, n, …, N)``. Its first row stands for zeros afterwards and is left as it was.

    Givens rotations from the last column to the first, all at once as Carlson (1973, *Fast triangular formulation of
    the square root filter*) writes them. With ``h`` the first row, ``q`` the leading column, ``p`` its first entry,
    and sums over the columns from i on,

        αᵢ² = p² + Σ h_k²,   bᵢ = p q + Σ h_k c_k,   cᵢ ← (αᵢ₊₁/αᵢ) cᵢ − hᵢ/(αᵢ αᵢ₊₁) bᵢ₊₁,   q ← b₀/α₀

    Lower triangular columns under a leading column of zeros stay so, and their diagonal is only ever multiplied by
    positive numbers: a root stays a root whatever the rounding.
    """
    n = others.shape[1]
    first, rest = others[0], others[1:]
    lengths = blank(first, (n + 1, *first.shape[1:]))
    np.multiply(first, first, out=lengths[:n])
    np.multiply(leading[0], leading[0], out=lengths[n])
    reach = blank(leading, (n + 1, *leading[1:].shape))
    np.multiply(first[:, None], transpose(rest), out=reach[:n])
    np.multiply(leading[0], leading[1:], out=reach[n])
    for i in reversed(range(n)):
        lengths[i] += lengths[i + 1]
        reach[i] += reach[i + 1]
    np.sqrt(lengths, out=lengths)
    longer, shorter = lengths[:-1], lengths[1:]
    rest *= shorter / longer
    rest -= (first / (longer * shorter)) * transpose(reach[1:])
    leading[0] = lengths[0]
    np.divide(reach[0], lengths[0], out=leading[1:])


def downdate(lower: Array, vector: Array) -> BoolArray:
    """``L Lᵀ ← L Lᵀ − u uᵀ`` in place, for a vector ``(n, N)``; where that had to be less to stay positive ``(N,)``.

    With ``L p = u`` the new root is the one of ``L (I − p pᵀ) Lᵀ``, a matter of :func:`rotate_in` (LINPACK, ``dchdd``).
    A vector that reaches beyond the covariance, ``‖p‖ ≥ 1``, is cut down to what all but takes its direction away.
    """
    reach = solve_lower(lower, vector[:, None].copy())
    left = 1.0 - tree_sum(np.square(reach[:, 0]))
    leading = zeros(lower, (len(lower) + 1, *vector.shape[1:]))
    np.sqrt(np.maximum(left, _SMALLEST_SHARE), out=leading[0])
    others = np.concatenate([transpose(reach), lower])
    rotate_in(leading, others)
    lower[...] = others[1:]
    cut: BoolArray = left < _SMALLEST_SHARE
    return cut
