"""Algebra of many small matrices at once, batch axis last.

A batch of ``n × n`` matrices is one array ``(n, n, …, N)``: the matrix axes lead, everything behind them is batch. Sums
over the small axes are accumulated in an order fixed by their length alone (:func:`tree_sum`), never handed to
``np.sum``, whose order depends on the memory layout: results are bit-equal for every batch size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from passloc_env.arrays import Array, BoolArray

_PIVOT_FLOOR = 1e-14
"""Pivots below this share of the diagonal are rounding noise, not variance."""


def tree_sum(terms: Array) -> Array:
    """Sum over the first axis by halving, ``(k, …)`` to ``(…)``. ``terms`` is used as scratch and overwritten."""
    count = len(terms)
    while count > 1:
        half = count // 2
        np.add(terms[:half], terms[half : 2 * half], out=terms[:half])
        if count % 2:
            np.add(terms[0], terms[count - 1], out=terms[0])
        count = half
    total: Array = terms[0]
    return total


def inner(a: Array, b: Array) -> Array:
    """Scalar product over the first axis, ``(n, …) · (n, …)`` to ``(…)``."""
    return tree_sum(a * b)


def matvec(matrix: Array, vector: Array) -> Array:
    """``A x``: ``(m, n, …)`` times ``(n, …)`` to ``(m, …)``."""
    return tree_sum(matrix.swapaxes(0, 1) * vector[:, None])


def matmul(a: Array, b: Array) -> Array:
    """``A B``: ``(m, k, …)`` times ``(k, n, …)`` to ``(m, n, …)``."""
    return tree_sum(a.swapaxes(0, 1)[:, :, None] * b[:, None])


def row_gram(matrix: Array) -> Array:
    """``A Aᵀ``: ``(n, w, …)`` to ``(n, n, …)``, zero when there are no columns; symmetric to the last bit."""
    if matrix.shape[1] == 0:
        return np.zeros((len(matrix), len(matrix), *matrix.shape[2:]))
    columns = matrix.swapaxes(0, 1)
    return tree_sum(columns[:, :, None] * columns[:, None])


def transpose(matrix: Array) -> Array:
    """``Aᵀ``, a view."""
    return matrix.swapaxes(0, 1)


def diagonal(matrix: Array) -> Array:
    """The diagonal ``(n, …)`` of ``(n, n, …)``, a writable view."""
    view: Array = np.einsum("ii...->i...", matrix)
    return view


class Factor(NamedTuple):
    """A Cholesky factor and whether every matrix of the batch was numerically positive definite."""

    lower: Array
    sound: bool


def cholesky(matrix: Array) -> Factor:
    """Lower Cholesky factor of ``(n, n, …, N)`` symmetric matrices; never raises.

    A pivot that is not above 1e-14 of its diagonal entry is replaced by that floor and ``sound`` is False;
    :func:`nearest_positive_definite` then tells what to factor instead.
    """
    n = len(matrix)
    lower = matrix.copy()
    floors = diagonal(lower) * _PIVOT_FLOOR
    for j in range(n):
        root = np.sqrt(np.maximum(lower[j, j], floors[j]))
        lower[j, j] = root
        if j + 1 < n:
            column = lower[j + 1 :, j]
            column /= root
            lower[j + 1 :, j + 1 :] -= column[:, None] * column[None]
            lower[j, j + 1 :] = 0.0
    pivots = diagonal(lower)
    sound = bool((pivots * pivots > 2.0 * floors).all())
    return Factor(lower, sound)


def unsound(matrix: Array) -> BoolArray:
    """Which matrices of the batch ``(n, n, N)`` are not numerically positive definite, as a mask ``(N,)``."""
    with np.errstate(all="ignore"):
        pivots = diagonal(cholesky(matrix).lower)
        healthy = (pivots * pivots > 2.0 * _PIVOT_FLOOR * diagonal(matrix)).all(axis=0)
    return np.logical_not(healthy)


def nearest_positive_definite(matrix: Array) -> Array:
    """``(n, n, k)`` symmetric matrices with their eigenvalues raised to at least 1e-10 of the largest one.

    The matrix is scaled to unit diagonal first, so that metres and metres per second are treated alike. Entries must be
    finite. Slow, exact, and meant for the few matrices that :func:`unsound` points at.
    """
    scale = np.sqrt(np.maximum(np.abs(diagonal(matrix)), 1e-300))
    correlation = np.moveaxis(matrix / scale[:, None] / scale[None], -1, 0)
    values, vectors = np.linalg.eigh(0.5 * (correlation + np.swapaxes(correlation, 1, 2)))
    floor = 1e-10 * np.maximum(values[:, -1:], 1.0)
    repaired = (vectors * np.maximum(values, floor)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    repaired = 0.5 * (repaired + np.swapaxes(repaired, 1, 2))
    result: Array = np.moveaxis(repaired, 0, -1) * scale[:, None] * scale[None]
    return result


def solve_lower(lower: Array, right: Array) -> Array:
    """``L⁻¹ B`` by forward substitution: ``(m, m, …)`` into ``(m, k, …)``; ``right`` is overwritten and returned."""
    for i in range(len(lower)):
        if i:
            right[i] -= tree_sum(lower[i, :i, None] * right[:i])
        right[i] /= lower[i, i]
    return right


def log_determinant(lower: Array) -> Array:
    """``ln det A`` of the matrices whose Cholesky factors ``(n, n, …)`` are given."""
    return 2.0 * tree_sum(np.log(diagonal(lower)))


def inverse_from_factor(lower: Array) -> Array:
    """``A⁻¹`` of the matrices whose Cholesky factors ``(n, n, …)`` are given; symmetric to the last bit."""
    right = np.zeros(lower.shape)
    diagonal(right)[...] = 1.0
    half = solve_lower(lower, right)
    return row_gram(transpose(half))


class LinearMap:
    """A matrix ``(m, n, 1|N)`` ready to be applied many times, its zeros left out.

    The matrix is stored as runs along its diagonals: the transition of a nearly-constant-velocity target in any number
    of dimensions is then the identity plus one run.

    Args:
        matrix: ``(m, n)`` or ``(m, n, 1|N)``; square unless it maps noise into states.
        dense: keep every entry, for matrices whose zeros differ between environments.
    """

    def __init__(self, matrix: Array, dense: bool = False) -> None:
        self.matrix = matrix if matrix.ndim == 3 else matrix[..., None]
        rows, columns = self.matrix.shape[:2]
        used = np.ones((rows, columns), bool) if dense else (self.matrix != 0.0).any(axis=-1)
        unit = not dense and rows == columns and bool((diagonal(self.matrix) == 1.0).all())
        self._identity = unit
        self._runs: list[tuple[slice, slice, Array]] = []
        for offset in range(-rows + 1, columns):
            if offset == 0 and unit:
                continue
            for first, last in _stretches(np.diagonal(used, offset)):
                row = slice(first - min(offset, 0), last - min(offset, 0))
                column = slice(first + max(offset, 0), last + max(offset, 0))
                entries = np.moveaxis(np.diagonal(self.matrix, offset), -1, 0)[first:last]
                self._runs.append((row, column, np.ascontiguousarray(entries)))

    def __call__(self, vectors: Array) -> Array:
        """``A x`` for ``(n, …, N)``, a new array ``(m, …, N)``."""
        result = vectors.copy() if self._identity else np.zeros((len(self.matrix), *vectors.shape[1:]))
        middle = (1,) * (vectors.ndim - 2)
        for row, column, entries in self._runs:
            shaped = entries.reshape(len(entries), *middle, entries.shape[-1])
            result[row] += shaped * vectors[column]
        return result

    def congruence(self, matrices: Array) -> Array:
        """``A P Aᵀ`` for ``(n, n, …, N)``, a new array."""
        once = self(matrices)
        return transpose(self(transpose(once)))


def _stretches(used: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Half-open intervals over which ``used`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], used, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
