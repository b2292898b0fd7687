"""The unscented Kalman filter, batched.

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

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray
from passloc_env.errors import ScenarioError
from passloc_env.fields import part, quantity
from passloc_env.linalg import cholesky, transpose, tree_sum
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.platforms import Pose
from passloc_env.sightline import Scene
from passloc_env.tracking.correction import correct, repair
from passloc_env.tracking.tracker import Models, Track, Tracker


@dataclass(frozen=True, kw_only=True)
class UnscentedKalman(Tracker):
    """Unscented Kalman filter with scaled sigma points; any motion, any sensors."""

    motion: Motion = part(Motion, "how it believes the emitter moves", ConstantVelocity())
    alpha: float = quantity("spread of the sigma points", 1.0, above=0, plain=True)
    beta: float = quantity("weight of the centre in the covariance; 2 suits a Gaussian", 2.0, plain=True)
    kappa: float = quantity("secondary spread", 0.0, plain=True)

    def build(self, models: Models, environments: int) -> UnscentedTrack:
        """The running filter; ScenarioError when kappa leaves no spread in this state size."""
        return UnscentedTrack(self, models, environments)


def check_spread(alpha: float, kappa: float, states: int) -> float:
    """``n + λ = α² (n + κ)``; ScenarioError when kappa leaves no spread to the sigma points."""
    if states + kappa <= 0.0:
        raise ScenarioError("kappa", kappa, f"must be above {-states} with {states} states")
    return alpha**2 * (states + kappa)


class UnscentedTrack(Track):
    """The running filter of a batch."""

    def __init__(self, filter_: UnscentedKalman, models: Models, environments: int) -> None:
        super().__init__(models, environments)
        n = models.layout.size
        self._spread = check_spread(filter_.alpha, filter_.kappa, n)
        self._weight = 0.5 / self._spread
        self._mean_correction = filter_.beta - filter_.alpha**2

    def predict(self, time: Array) -> None:
        """``x ← f(x)``, ``P ← F P Fᵀ + Q`` or its sigma-point form."""
        dynamics = self.models.dynamics
        if dynamics.linear:
            dynamics.advance(self.mean, time)
            dynamics.spread(self.covariance)
            return
        points = self._points(self._offsets())
        moved = dynamics.mean(points, time)
        deviations = transpose(moved[:, 1:] - moved[:, :1])
        shift = self._weight * tree_sum(deviations.copy())
        self.mean[...] = moved[:, 0] + shift
        self.covariance[...] = self._moment(deviations, shift) + dynamics.process_noise

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """The equations of the module's head."""
        suite = self.models.suite
        n = len(self.mean)
        offsets = self._offsets()
        predicted = suite.measure(Scene(self._points(offsets), self.models.layout, poses))
        centre = predicted[:, :1].copy()
        predicted[:, 0] = measurement
        predicted -= centre
        suite.wrap(predicted)
        deviations = transpose(predicted[:, 1:])
        shift = self._weight * tree_sum(deviations.copy())
        innovation_covariance = self._moment(deviations, shift) + suite.noise_covariance

        right = np.empty((suite.size, n + 1, self.mean.shape[1]))
        cross, innovation = right[:, :n], right[:, n]
        slopes = deviations[:n] - deviations[n:]
        np.multiply(tree_sum(slopes[:, :, None] * transpose(offsets)[:, None]), self._weight, out=cross)
        np.subtract(predicted[:, 0], shift, out=innovation)
        correct(self, right, innovation_covariance, suite.noise_pivots, detected)

    def _offsets(self) -> Array:
        """Columns ``√(n+λ) L (n, n, N)``; repairs covariances that rounding has spoilt."""
        lower, sound = cholesky(self.covariance, self._spread)
        if not sound:
            repair(self)
            lower, _ = cholesky(self.covariance, self._spread)
        return lower

    def _points(self, offsets: Array) -> Array:
        """Sigma points ``(n, 2n + 1, N)``, the centre first."""
        n, size = self.mean.shape
        points = np.empty((n, 2 * n + 1, size))
        centre = self.mean[:, None]
        points[:, :1] = centre
        np.add(centre, offsets, out=points[:, 1 : n + 1])
        np.subtract(centre, offsets, out=points[:, n + 1 :])
        return points

    def _moment(self, deviations: Array, shift: Array) -> Array:
        """Second moment ``(k, k, N)`` of deviations ``(2n, k, N)`` from the centre point, about their mean."""
        moment = tree_sum(deviations[:, :, None] * deviations[:, None])
        moment *= self._weight
        if self._mean_correction:
            moment += self._mean_correction * (shift[:, None] * shift[None])
        return moment
