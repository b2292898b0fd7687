"""The unscented transform of beliefs, one or many side by side, batched.

Scaled sigma points (van der Merwe) are drawn from the predicted covariance: ``x̄, x̄ ± √(n+λ) L`` with ``P = L Lᵀ``.
For a linear motion the prediction is exactly ``F x``, ``F P Fᵀ + Q``; for a nonlinear one sigma points carry it. All
measurement statistics are taken relative to the centre point, so that angles need one wrap and means never flip. With
``d_i = h(x_i) − h(x̄)`` and ``μ = w Σ d_i``:

    S   = w Σ d_i d_iᵀ + (β − α²) μ μᵀ + R
    Pxz = w Σ o_i (d_i⁺ − d_i⁻)ᵀ
    K   = Pxz S⁻¹,   x ← x + K (z − h(x̄) − μ),   P ← P − K S Kᵀ

which equals the textbook form (Wan & van der Merwe 2000) because the offsets ``± o_i`` are antisymmetric.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from passloc_env.arrays import Array, BoolArray, blank
from passloc_env.dynamics import Dynamics
from passloc_env.errors import ScenarioError
from passloc_env.linalg import cholesky, spaced, transpose, tree_sum
from passloc_env.platforms import Pose
from passloc_env.sightline import Scene
from passloc_env.tracking.correction import Gaussian, correct, repair
from passloc_env.tracking.tracker import Models

Admission = Callable[[Array, Array, BoolArray | None], BoolArray | None]
"""Which scalars are to be used, of innovations, their covariance and what was detected; see :meth:`Track.admit`."""


class Innovation(NamedTuple):
    """What a measurement differs by from what was expected of it, as :func:`correct` takes it.

    Attributes:
        right: ``[Pxzᵀ | y]``, the cross covariance ``(m, n, …, N)`` and behind it the innovation itself.
        covariance: ``S (m, m, …, N)``.
    """

    right: Array
    covariance: Array

    @property
    def value(self) -> Array:
        """``y (m, …, N)``, a view."""
        return self.right[:, -1]


def check_spread(alpha: float, kappa: float, states: int) -> float:
    """``n + λ = α² (n + κ)``; ScenarioError when kappa leaves no spread to the sigma points."""
    if states + kappa <= 0.0:
        raise ScenarioError("kappa", kappa, f"must be above {-states} with {states} states")
    return alpha**2 * (states + kappa)


class UnscentedTransform:
    """The step of an unscented filter for beliefs of ``n`` states, in place.

    Args:
        states: n.
        alpha: spread of the sigma points.
        beta: weight of the centre in the covariance.
        kappa: secondary spread.

    Raises:
        ScenarioError: kappa leaves no spread in this state size.
    """

    def __init__(self, states: int, alpha: float, beta: float, kappa: float) -> None:
        self._spread = check_spread(alpha, kappa, states)
        self._weight = 0.5 / self._spread
        self._mean_correction = beta - alpha**2

    def predict(self, belief: Gaussian, dynamics: Dynamics, time: Array) -> None:
        """``x ← f(x)``, ``P ← F P Fᵀ + Q`` or its sigma-point form, from ``time (N,)``."""
        mean, covariance = belief.mean, belief.covariance
        if dynamics.linear:
            dynamics.advance(mean, time)
            dynamics.spread(covariance)
            return
        points = sigma_points(mean, self._offsets(belief))
        moved = dynamics.mean(points, time)
        deviations = transpose(moved[:, 1:] - moved[:, :1])
        shift = self._weight * tree_sum(deviations.copy())
        mean[...] = moved[:, 0] + shift
        covariance[...] = self.moment(deviations, shift) + spaced(dynamics.process_noise, covariance.ndim)

    def update(
        self,
        belief: Gaussian,
        models: Models,
        measurement: Array,
        poses: list[Pose],
        detected: BoolArray | None,
        admit: Admission,
    ) -> Array:
        """Absorb a measurement ``(m, N)`` by the equations of the module's head, or what is admitted of it.

        Returns:
            The Cholesky factor of the innovation covariance, see :func:`~passloc_env.tracking.correction.correct`.
        """
        innovation = self.innovation(belief, models, measurement, poses)
        used = admit(innovation.value, innovation.covariance, detected)
        return correct(belief, *innovation, models.suite.noise_pivots, used)

    def innovation(self, belief: Gaussian, models: Models, measurement: Array, poses: list[Pose]) -> Innovation:
        """What a measurement ``(m, N)`` says that was not expected; repairs covariances that rounding has spoilt."""
        suite, n = models.suite, len(belief.mean)
        offsets = self._offsets(belief)
        predicted = suite.measure(Scene(sigma_points(belief.mean, offsets), models.layout, poses))
        centre = predicted[:, :1].copy()
        predicted[:, 0] = spaced(measurement, belief.mean.ndim)
        predicted -= centre
        suite.wrap(predicted)
        deviations = transpose(predicted[:, 1:])
        shift = self._weight * tree_sum(deviations.copy())
        noise = spaced(suite.noise_covariance, belief.covariance.ndim)
        covariance = self.moment(deviations, shift) + noise

        right = blank(belief.mean, (suite.size, n + 1, *belief.mean.shape[1:]))
        slopes = deviations[:n] - deviations[n:]
        np.multiply(tree_sum(slopes[:, :, None] * transpose(offsets)[:, None]), self._weight, out=right[:, :n])
        np.subtract(predicted[:, 0], shift, out=right[:, n])
        return Innovation(right, covariance)

    def _offsets(self, belief: Gaussian) -> Array:
        """Columns ``√(n+λ) L (n, n, …, N)``; repairs covariances that rounding has spoilt."""
        lower, sound = cholesky(belief.covariance, self._spread)
        if not sound:
            repair(belief)
            lower, _ = cholesky(belief.covariance, self._spread)
        return lower

    def moment(self, deviations: Array, shift: Array) -> Array:
        """Second moment ``(k, k, …, N)`` of deviations ``(2n, k, …, N)`` from the centre point, about their mean."""
        moment = tree_sum(deviations[:, :, None] * deviations[:, None])
        moment *= self._weight
        if self._mean_correction:
            moment += self._mean_correction * (shift[:, None] * shift[None])
        return moment


def sigma_points(mean: Array, offsets: Array) -> Array:
    """Sigma points ``(n, 2n + 1, …, N)``, the centre first."""
    n, *middle = mean.shape
    points = blank(mean, (n, 2 * n + 1, *middle))
    centre = mean[:, None]
    points[:, :1] = centre
    np.add(centre, offsets, out=points[:, 1 : n + 1])
    np.subtract(centre, offsets, out=points[:, n + 1 :])
    return points
