"""Rank and condition of a record, and the direction it leaves in the dark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array, IntArray
from passloc_env.checks import require_exactly, require_positive
from passloc_env.errors import InputError
from passloc_env.layout import StateLayout
from passloc_env.linalg import transpose
from passloc_env.observability.gramian import observability_matrix


@dataclass(frozen=True)
class RankReport:
    """What a record of measurements determines of the state.

    Attributes:
        rank: ``(N,)``.
        condition: largest over smallest singular value of the scaled observability matrix ``(N,)``; the Gramian's
            condition is its square.
        weakest: the direction known worst, in state units ``(n, N)``, its largest entry positive.
        weakest_name: the state that dominates it, per environment.
    """

    rank: IntArray
    condition: Array
    weakest: Array
    weakest_name: tuple[str, ...]


def record_scale(layout: StateLayout, duration: float) -> Array:
    """What counts as one in each state when time is counted in records: everything becomes a speed.

    A metre per second for velocities and for nuisances (the constant of
    :func:`~passloc_env.observability.augmented_pseudo_linear_rows` is one), and what it comes to within a record for
    the others: ``duration`` metres for positions, ``1/duration`` m/s² for accelerations. Neither the units of length
    and time nor the length of the record then decide the condition, only the geometry does.

    Args:
        layout: rows of the state.
        duration: length of the record, s.

    Returns:
        ``(n,)``, the ``scale`` of :func:`rank_report`.

    Raises:
        InputError: a duration that is not finite and positive.
    """
    require_positive("duration", duration)
    scale = np.ones(layout.size)
    scale[layout.position] = duration
    scale[layout.acceleration] = 1.0 / duration
    return scale


def rank_report(
    rows: ArrayLike, transition: ArrayLike, layout: StateLayout, scale: ArrayLike, tolerance: float = 1e-9
) -> RankReport:
    """Rank and condition of a record, and the weakest direction by name.

    Metres and metres per second cannot be compared, so the state is measured in units of ``scale`` first.

    Args:
        rows: ``(K, m, n, N)``.
        transition: of one step.
        layout: rows of the state.
        scale: what counts as one in each state ``(n,)``, e.g. the prior standard deviations or :func:`record_scale`.
        tolerance: singular values below this share of the largest count as zero.

    Raises:
        InputError: shapes that do not match, numbers that are not finite, a scale that is not positive.
    """
    matrix = observability_matrix(rows, transition)
    if matrix.shape[1] != layout.size:
        raise InputError(f"rows of {matrix.shape[1]} states is not possible: the layout has {layout.size}")
    units = require_exactly("scale", scale, (layout.size,))
    require_positive("scale", float(units.min()))
    stacked = np.moveaxis(matrix * units[:, None], -1, 0)
    # Rows of zeros change no Gramian; with at least n rows the SVD gives all n directions.
    missing = max(layout.size - stacked.shape[1], 0)
    stacked = np.pad(stacked, ((0, 0), (0, missing), (0, 0)))
    _, values, right = np.linalg.svd(stacked, full_matrices=False)
    rank = (values > tolerance * values[:, :1]).sum(axis=1)
    weakest = transpose(right[:, -1]) * units[:, None]
    dominant = np.abs(right[:, -1]).argmax(axis=1)
    weakest = weakest * np.sign(weakest[dominant, np.arange(len(dominant))])
    smallest = values[:, -1]
    condition = np.full(len(values), np.inf)
    np.divide(values[:, 0], smallest, out=condition, where=smallest > 0.0)
    return RankReport(rank, condition, weakest, tuple(layout.names[index] for index in dominant))
