"""Whether a state can be found at all: Gramians, their determinants and ranks.

A linear (or linearised) problem ``x_k = Φ x_{k−1}``, ``z_k = H_k x_k`` is observable from the start iff the rows
``H_k Φᵏ`` span the state space, that is, iff the Gramian ``G = Σ (Φᵏ)ᵀ H_kᵀ H_k Φᵏ`` has full rank. With rows divided
by their noise the Gramian is the Fisher information of the initial state. With the *pseudo-linear* rows of bearing and
Doppler, whose coefficients are the measurements themselves, it needs no estimate of the state (paper 000, eqs. 5–9).

Shapes: rows ``(K, m, n, N)`` for K instants of m scalars; matrices ``(n, n, N)``; the batch axis comes last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, IntArray
from passloc_env.layout import StateLayout
from passloc_env.linalg import cholesky, log_determinant, solve_lower, transpose
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sightline import Scene


def pseudo_linear_rows(bearing: Array, layout: StateLayout, doppler: bool = False) -> Array:
    """Rows of the pseudo-linear measurement at given bearings, planar problems.

    ``0 = cos θ · x − sin θ · y`` relative to the observer, and with Doppler
    ``−(f − f₀) c / f₀ = sin θ · v_x + cos θ · v_y``.

    Args:
        bearing: ``(K, N)``, rad.
        layout: rows of the state.
        doppler: whether the second row is there too.

    Returns:
        ``(K, 1 or 2, n, N)``; the bearing row in metres per metre, the Doppler row in m/s per m/s.
    """
    steps, batch = bearing.shape
    sine, cosine = np.sin(bearing), np.cos(bearing)
    rows = np.zeros((steps, 2 if doppler else 1, layout.size, batch))
    rows[:, 0, layout.position] = np.stack([cosine, -sine], axis=1)
    if doppler:
        rows[:, 1, layout.velocity] = np.stack([sine, cosine], axis=1)
    return rows


def fisher_rows(suite: SensorSuite, scene: Scene) -> Array:
    """The measurement Jacobian of a scene divided by the noise: ``R^{-1/2} H (m, n, N)``.

    A simulation offers both, ``simulation.models.suite`` and ``simulation.bound_scene()``; stack what a watcher
    collects to ``(K, m, n, N)``.
    """
    return solve_lower(cholesky(suite.noise_covariance).lower, suite.jacobian(scene))


def observability_matrix(rows: Array, transition: Array) -> Array:
    """``H_k Φᵏ`` of all instants below each other, ``(K m, n, N)``.

    Args:
        rows: ``(K, m, n, N)``; instant k is k steps after the state that is asked for.
        transition: ``Φ (n, n)`` or ``(n, n, 1|N)`` of one step.
    """
    steps, scalars, n, batch = rows.shape
    step = transition if transition.ndim == 3 else transition[..., None]
    mapped = np.empty(rows.shape)
    power = np.broadcast_to(np.eye(n)[..., None], (n, n, step.shape[-1]))
    for k in range(steps):
        mapped[k] = np.einsum("mib,ijb->mjb", rows[k], np.broadcast_to(power, (n, n, batch)))
        power = np.einsum("ijb,jkb->ikb", step, power)
    return mapped.reshape(steps * scalars, n, batch)


def gramian(rows: Array, transition: Array) -> Array:
    """``Σ (Φᵏ)ᵀ H_kᵀ H_k Φᵏ``, ``(n, n, N)``; arguments as for :func:`observability_matrix`."""
    stacked = observability_matrix(rows, transition)
    product: Array = np.einsum("kib,kjb->ijb", stacked, stacked)
    return product


def windowed_gram_determinant(rows: Array, transition: Array, window: int) -> Array:
    """``ln det`` of the Gramian of each window of consecutive instants, mapped to the window's own start.

    Args:
        rows: ``(K, m, n, N)``.
        transition: of one step.
        window: instants per window.

    Returns:
        ``(K − window + 1, N)``; −inf where a window does not see the whole state.

    Raises:
        ValueError: a window below one or longer than the record.
    """
    steps = len(rows)
    if not 1 <= window <= steps:
        raise ValueError(f"window = {window} is not possible: must be between 1 and the {steps} instants given")
    determinants = np.empty((steps - window + 1, rows.shape[-1]))
    for first in range(steps - window + 1):
        stacked = np.moveaxis(observability_matrix(rows[first : first + window], transition), -1, 0)
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


def gram_gain(before: Array, after: Array, prior_information: Array) -> Array:
    """``ln det(G_k + P₀⁻¹) − ln det(G_{k−1} + P₀⁻¹)`` for Gramians ``(n, n, N)`` in Fisher units, ``(N,)``."""
    return log_determinant(cholesky(after + prior_information).lower) - log_determinant(
        cholesky(before + prior_information).lower
    )


@dataclass(frozen=True)
class RankReport:
    """What a record of measurements determines of the state.

    Attributes:
        rank: ``(N,)``.
        condition: largest over smallest singular value of the scaled observability matrix ``(N,)``.
        weakest: the direction known worst, in state units ``(n, N)``, its largest entry positive.
        weakest_name: the state that dominates it, per environment.
    """

    rank: IntArray
    condition: Array
    weakest: Array
    weakest_name: tuple[str, ...]


def rank_report(
    rows: Array, transition: Array, layout: StateLayout, scale: Array, tolerance: float = 1e-9
) -> RankReport:
    """Rank and condition of a record, and the weakest direction by name.

    Metres and metres per second cannot be compared, so the state is measured in units of ``scale`` first.

    Args:
        rows: ``(K, m, n, N)``.
        transition: of one step.
        layout: rows of the state.
        scale: what counts as one in each state ``(n,)``, e.g. the prior standard deviations.
        tolerance: singular values below this share of the largest count as zero.
    """
    stacked = np.moveaxis(observability_matrix(rows, transition) * scale[:, None], -1, 0)
    _, values, right = np.linalg.svd(stacked, full_matrices=True)
    n = layout.size
    values = np.concatenate([values, np.zeros((len(values), n - values.shape[1]))], axis=1)
    rank = (values > tolerance * values[:, :1]).sum(axis=1)
    weakest = transpose(right[:, -1]) * scale[:, None]
    relative = np.abs(right[:, -1])
    dominant = relative.argmax(axis=1)
    weakest = weakest * np.sign(weakest[dominant, np.arange(len(dominant))])
    with np.errstate(divide="ignore"):
        condition = values[:, 0] / values[:, -1]
    return RankReport(rank, condition, weakest, tuple(layout.names[index] for index in dominant))
