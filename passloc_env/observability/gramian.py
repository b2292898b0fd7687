"""Observability matrices and Gramians of any rows along any record, their determinants and gains."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array, BoolArray
from passloc_env.checks import require_count, require_exactly, require_shape
from passloc_env.errors import InputError
from passloc_env.linalg import cholesky, log_determinant, matmul, row_gram, transpose
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sightline import Scene


def fisher_rows(
    suite: SensorSuite, scene: Scene, detected: BoolArray | None = None, inflation: Array | None = None
) -> Array:
    """The measurement Jacobian of a scene divided by the noise: ``R^{-1/2} H (m, n, N)``.

    A simulation offers all three, ``simulation.models.suite``, ``simulation.bound_scene()`` and
    ``simulation.detected``; stack what a watcher collects to ``(K, m, n, N)``.

    Args:
        suite: what is heard.
        scene: true geometry.
        detected: which scalars ``(m, N)`` were measured; rows of the others are zero. None means all.
        inflation: how many times as wide as usual their errors are ``(m, N)``; None where there are no outliers.
    """
    jacobian = suite.jacobian(scene)
    if inflation is not None:
        jacobian /= inflation[:, None]
    if detected is not None:
        jacobian *= detected[:, None]
    return suite.whitened(jacobian)


def observability_matrix(rows: ArrayLike, transition: ArrayLike) -> Array:
    """``H_k Φᵏ`` of all instants below each other, ``(K m, n, N)`` (paper 000, eq. 5).

    Args:
        rows: ``(K, m, n, N)``; instant k is k steps after the state that is asked for.
        transition: ``Φ (n, n)`` or ``(n, n, 1|N)`` of one step.

    Raises:
        InputError: other shapes, numbers that are not finite.
    """
    record, step = _rows_and_transition(rows, transition)
    instants, scalars, n, batch = record.shape
    mapped = np.empty(record.shape)
    power = np.broadcast_to(np.eye(n)[..., None], step.shape)
    for k in range(instants):
        mapped[k] = matmul(record[k], power)
        power = matmul(step, power)
    return mapped.reshape(instants * scalars, n, batch)


def _rows_and_transition(rows: ArrayLike, transition: ArrayLike) -> tuple[Array, Array]:
    """Rows ``(K, m, n, N)`` and the transition ``(n, n, 1|N)``, checked."""
    record = require_shape("rows", rows, 4, "instants, scalars, states and environments")
    n, batch = record.shape[2:]
    step = require_exactly("transition", transition, (n, n), (n, n, 1), (n, n, batch))
    return record, step if step.ndim == 3 else step[..., None]


def gramian(rows: ArrayLike, transition: ArrayLike) -> Array:
    """``Σ (Φᵏ)ᵀ H_kᵀ H_k Φᵏ``, ``(n, n, N)`` (paper 000, eq. 4); as for :func:`observability_matrix`."""
    record, step = _rows_and_transition(rows, transition)
    _, scalars, n, batch = record.shape
    total = np.zeros((n, n, batch))
    for block in observability_matrix(record, step).reshape(-1, scalars, n, batch):
        total += row_gram(transpose(block))
    return total


def windowed_gram_determinant(rows: ArrayLike, transition: ArrayLike, window: int) -> Array:
    """``ln det`` of the Gramian of each window of consecutive instants, mapped to the window's own start.

    Args:
        rows: ``(K, m, n, N)``.
        transition: of one step.
        window: instants per window.

    Returns:
        ``(K − window + 1, N)``; −inf where a window does not see the whole state.

    Raises:
        InputError: a window below one or longer than the record, other shapes, numbers that are not finite.
    """
    record, step = _rows_and_transition(rows, transition)
    require_count("window", window, at_least=1)
    steps = len(record)
    if window > steps:
        raise InputError(f"window = {window} is not possible: must be between 1 and the {steps} instants given")
    determinants = np.empty((steps - window + 1, record.shape[-1]))
    for first in range(steps - window + 1):
        stacked = np.moveaxis(observability_matrix(record[first : first + window], step), -1, 0)
        determinants[first] = _log_gram_determinant(stacked)
    return determinants


def _log_gram_determinant(stacked: Array) -> Array:
    """``ln det(OᵀO)`` of matrices ``(N, k, n)`` from their singular values, which lose half as many digits."""
    if stacked.shape[1] < stacked.shape[2]:
        return np.full(len(stacked), -np.inf)
    values = np.linalg.svd(stacked, compute_uv=False)
    with np.errstate(divide="ignore"):
        logarithm: Array = 2.0 * np.log(values).sum(axis=-1)
    return logarithm


def gram_gain(before: ArrayLike, after: ArrayLike, prior_information: ArrayLike) -> Array:
    """``ln det(G_k + P₀⁻¹) − ln det(G_{k−1} + P₀⁻¹)`` for Gramians ``(n, n, N)`` in Fisher units, ``(N,)``.

    Raises:
        InputError: other shapes than ``(n, n, N)``, for the prior also ``(n, n, 1)``; numbers that are not finite.
    """
    earlier = require_shape("before", before, 3, "(n, n, environments)")
    n, _, batch = earlier.shape
    require_exactly("before", earlier, (n, n, batch))
    later = require_exactly("after", after, earlier.shape)
    prior = require_exactly("prior_information", prior_information, earlier.shape, (n, n, 1))
    return log_determinant(cholesky(later + prior).lower) - log_determinant(cholesky(earlier + prior).lower)
