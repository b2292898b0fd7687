"""Algebra of many small matrices at once, batch axis last.

A batch of ``n × n`` matrices is one array ``(n, n, …, N)``: the matrix axes lead, everything behind them is batch. Sums
over the small axes are accumulated in an order fixed by their length alone (:func:`tree_sum`), never handed to
``np.sum``, whose order depends on the memory layout: results are bit-equal for every batch size.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from passloc_env.arrays import Array, BoolArray, zeros

Entries = TypeVar("Entries", Array, BoolArray)

_PIVOT_FLOOR = 1e-14
"""Pivots below this share of the diagonal are rounding noise, not variance."""


def tree_sum(terms: Array) -> Array:
    """Sum over the first axis by halving, ``(k, …)`` to ``(…)``. ``terms`` is used as scratch and overwritten."""
    count = len(terms)
    while count > 2:
        half = count // 2
        merged = terms[:half]
        merged += terms[half : 2 * half]
        if count % 2:
            merged[0] += terms[count - 1]
        count = half
    total: Array = terms[0] + terms[1] if count == 2 else terms[0]
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
        return zeros(matrix, (len(matrix), len(matrix), *matrix.shape[2:]))
    columns = matrix.swapaxes(0, 1)
    return tree_sum(columns[:, :, None] * columns[:, None])


def spaced(values: Entries, axes: int) -> Entries:
    """``(…, 1|N)`` with unit axes put before the batch axis until it has so many ``axes``: ready for middle axes."""
    missing = axes - values.ndim
    if missing <= 0:
        return values
    return values.reshape(*values.shape[:-1], *(1,) * missing, values.shape[-1])


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


def cholesky(matrix: Array, scale: float = 1.0) -> Factor:
    """Lower Cholesky factor of ``scale`` times symmetric matrices ``(n, n, …, N)``; never raises.

    Where a pivot is not above 1e-14 of its diagonal entry, ``sound`` is False and the factor of that matrix is
    meaningless; :func:`nearest_positive_definite` then tells what to factor instead.
    """
    lower, sound = _factor(matrix, scale)
    return Factor(lower, bool(np.logical_and.reduce(sound, axis=None)))


def _factor(matrix: Array, scale: float = 1.0) -> tuple[Array, BoolArray]:
    """The lower factor, and which pivots ``(n, …)`` stood above their floors."""
    n = len(matrix)
    rest = np.multiply(matrix, scale, order="C")
    floors = _flat_diagonal(rest) * _PIVOT_FLOOR
    lower = zeros(rest, rest.shape)
    for j in range(n):
        np.sqrt(np.maximum(rest[j, j], floors[j]), out=lower[j, j])
        if j + 1 < n:
            column = np.multiply(rest[j + 1 :, j], 1.0 / lower[j, j], out=lower[j + 1 :, j])
            rest[j + 1 :, j + 1 :] -= column[:, None] * column
    return lower, _flat_diagonal(rest) > floors


def cholesky_above(matrix: Array, floors: Array) -> Array:
    """Lower Cholesky factor of ``(m, m, …)`` whose pivots are known to be at least ``floors (m, …)``; never raises.

    An innovation covariance ``H P Hᵀ + R`` has no pivot below the one of R: where rounding says otherwise, rounding is
    wrong. The matrix is overwritten and returned, with rubbish above the diagonal.
    """
    for j in range(len(matrix)):
        pivot = matrix[j, j]
        np.sqrt(np.maximum(pivot, floors[j]), out=pivot)
        column = matrix[j + 1 :, j]
        if len(column):
            column *= 1.0 / pivot
            matrix[j + 1 :, j + 1 :] -= column[:, None] * column
    return matrix


def _flat_diagonal(matrix: Array) -> Array:
    """The diagonal ``(n, …)`` of a contiguous matrix, a view."""
    n = len(matrix)
    return matrix.reshape(n * n, *matrix.shape[2:])[:: n + 1]


def unsound(matrix: Array) -> BoolArray:
    """Which matrices of the batch ``(n, n, …, N)`` are not numerically positive definite, as a mask ``(…, N)``."""
    with np.errstate(all="ignore"):
        return ~np.logical_and.reduce(_factor(matrix)[1], axis=0)


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
    result: Array = np.moveaxis(repaired, 0, -1) * (scale[:, None] * scale[None])
    return result


def mend(matrix: Array) -> BoolArray:
    """Make those ``(n, n, …, N)`` positive definite, in place, that are finite and not so; which ones ``(…, N)``."""
    broken = unsound(matrix) & np.isfinite(matrix).all(axis=(0, 1))
    matrix[..., broken] = nearest_positive_definite(matrix[..., broken])
    return broken


def solve_lower(lower: Array, right: Array) -> Array:
    """``L⁻¹ B`` by forward substitution: ``(m, m, …)`` into ``(m, k, …)``; ``right`` is overwritten and returned."""
    for i in range(len(lower)):
        if i:
            right[i] -= tree_sum(lower[i, :i, None] * right[:i])
        right[i] *= 1.0 / lower[i, i]
    return right


def log_determinant(lower: Array) -> Array:
    """``ln det A`` of the matrices whose Cholesky factors ``(n, n, …)`` are given."""
    return 2.0 * tree_sum(np.log(diagonal(lower)))


def inverse_from_factor(lower: Array) -> Array:
    """``A⁻¹`` of the matrices whose Cholesky factors ``(n, n, …)`` are given; symmetric to the last bit."""
    right = zeros(lower, lower.shape)
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
        self._identity = not dense and rows == columns and bool((diagonal(self.matrix) == 1.0).all())
        self._runs: list[tuple[slice, slice, Array]] = []
        for offset in range(-rows + 1, columns):
            if offset == 0 and self._identity:
                continue
            for first, last in _stretches(np.diagonal(used, offset)):
                row = slice(first - min(offset, 0), last - min(offset, 0))
                column = slice(first + max(offset, 0), last + max(offset, 0))
                entries = np.moveaxis(np.diagonal(self.matrix, offset), -1, 0)[first:last]
                self._runs.append((row, column, np.ascontiguousarray(entries)))
        self._in_place = self._identity and self._reads_before_it_writes()
        whole = (slice(0, rows), slice(0, columns))
        self._is_diagonal = rows == columns and [run[:2] for run in self._runs] == [whole]

    def _reads_before_it_writes(self) -> bool:
        """Whether no run reads rows that an earlier one has written."""
        written: set[int] = set()
        for row, column, _ in self._runs:
            if written & set(range(column.start, column.stop)):
                return False
            written |= set(range(row.start, row.stop))
        return True

    def __call__(self, vectors: Array) -> Array:
        """``A x`` for ``(n, …, N)``, a new array ``(m, …, N)``."""
        if self._is_diagonal and vectors.ndim == 2:
            return self._runs[0][2] * vectors
        result = vectors.copy() if self._identity else zeros(vectors, (len(self.matrix), *vectors.shape[1:]))
        self._add_runs(vectors, result)
        return result

    def apply(self, vectors: Array) -> None:
        """``x ← A x`` in place."""
        if self._in_place:
            self._add_runs(vectors, vectors)
        else:
            vectors[...] = self(vectors)

    def congruence(self, matrices: Array) -> None:
        """``P ← A P Aᵀ`` in place for symmetric ``(n, n, …, N)``; symmetric again, to the last bit."""
        if self._in_place and len(self._runs) == 1 and self._runs[0][0].start == 0:
            self._leading_congruence(matrices)
            return
        self.apply(matrices)
        self.apply(transpose(matrices))
        matrices += transpose(matrices)
        matrices *= 0.5

    def _leading_congruence(self, matrices: Array) -> None:
        """The same where only the leading rows change: half the work, for the other rows follow by symmetry."""
        lead, column, entries = self._runs[0]
        entries = entries.reshape(len(entries), *(1,) * (matrices.ndim - 2), -1)
        stripe = matrices[lead]
        stripe += entries * matrices[column]
        block = stripe[:, lead] + stripe[:, column] * transpose(entries)
        for row in range(1, len(block)):
            block[:row, row] = block[row, :row]
        stripe[:, lead] = block
        matrices[lead.stop :, lead] = transpose(stripe[:, lead.stop :])

    def _add_runs(self, vectors: Array, result: Array) -> None:
        middle = vectors.ndim - 2
        for row, column, entries in self._runs:
            if middle:
                entries = entries.reshape(len(entries), *(1,) * middle, -1)
            target = result[row]
            target += entries * vectors[column]


def _stretches(used: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Half-open intervals over which ``used`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], used, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
