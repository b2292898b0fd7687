"""The square-root unscented Kalman filter, batched.

The filter of :mod:`passloc_env.tracking.ukf` with the lower Cholesky factor L of the covariance as its state (van der
Merwe & Wan 2001, *The square-root unscented Kalman filter for state and parameter estimation*), so that no covariance
is ever subtracted from another one. With ``d_i = h(x_i) − h(x̄)``, ``μ = w Σ d_i`` and sigma points in pairs ``±``, the
joint covariance of measurement and state is the square of

    [ E  H ]    E = √(w/2) (d⁺ + d⁻ − 2tμ) beside R^½,   what no linear measurement explains and what noise adds,
    [ 0  L ]    H = √(w/2) (d⁺ − d⁻),                    the slopes along the columns of L.

One triangularisation of E and one rotation for each scalar make that ``[S^½ 0; K S^½ L]``, whose last block is the root
of ``P − K S Kᵀ``. The paper adds the centre point by a Cholesky update or, where its weight is negative, by a downdate;
here the deviations are taken about a share t of their mean instead, which says the same for every weight of the centre
down to ``β = −α² κ/n``, however small α is. Below that a downdate is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, blank, lasting, zeros
from passloc_env.linalg import cholesky, diagonal, mend, solve_lower, transpose, tree_sum
from passloc_env.platforms import Pose
from passloc_env.sightline import Scene
from passloc_env.tracking.gating import gate_of
from passloc_env.tracking.tracker import Models, Track
from passloc_env.tracking.ukf import UnscentedKalman
from passloc_env.tracking.unscented import check_spread, sigma_points
from passloc_env.triangular import downdate, lower_gram, rotate_in, triangularise


@dataclass(frozen=True, kw_only=True)
class SquareRootKalman(UnscentedKalman):
    """Unscented Kalman filter that carries a root of the covariance: for noise far below what is unknown at first.

    The same belief as that of :class:`passloc_env.tracking.UnscentedKalman` where that one needs no repairs.
    """

    def build(self, models: Models, environments: int) -> Track:
        """The running filter; ScenarioError when kappa leaves no spread in this state size."""
        return SquareRootTrack(self, models, environments)


class SquareRootTrack(Track):
    """The running filter of a batch.

    Attributes:
        root: the lower Cholesky factor ``L (n, n, N)`` that the filter runs on; ``covariance`` is ``L Lᵀ``. Once the
            variances span sixteen orders of magnitude only the root can tell that they are positive.
        repairs: counts priors that were not positive definite, and downdates that had to be cut.
    """

    def __init__(self, filter_: SquareRootKalman, models: Models, environments: int) -> None:
        super().__init__(models, environments)
        n = models.layout.size
        self.root: Array = lasting((n, n, environments))
        self._transform = filter_.transform(n)
        self.gate = gate_of(filter_.gate, models.suite)
        self._spread = check_spread(filter_.alpha, filter_.kappa, n)
        self._weight = 0.5 / self._spread
        # w Σ (d − tμ)(d − tμ)ᵀ = w Σ d dᵀ + (rt² − 2t) μ μᵀ, and the filter's coefficient of μ μᵀ is β − α².
        ratio = n / self._spread
        above_least = 1.0 + ratio * (filter_.beta - filter_.alpha**2)
        self._share = (1.0 - math.sqrt(max(above_least, 0.0))) / ratio
        self._excess = math.sqrt(max(-above_least, 0.0) / ratio)

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew in the given environments from a prior ``(n, k)``, ``(n, n, k)``."""
        super().start(columns, mean, covariance, origin)
        lower, sound = cholesky(covariance)
        if not sound:
            mended = covariance.copy()
            self.repairs[columns] += mend(mended)
            lower = cholesky(mended).lower
        self.root[..., columns] = lower
        self.covariance[..., columns] = lower_gram(lower)

    def predict(self, time: Array) -> None:
        """``x ← f(x)``, ``L ← √(F P Fᵀ + Q)`` or its sigma-point form."""
        dynamics = self.models.dynamics
        gain = np.broadcast_to(dynamics.noise_gain, (*dynamics.noise_gain.shape[:2], self.mean.shape[1]))
        if dynamics.linear:
            dynamics.advance(self.mean, time)
            self.root[...] = triangularise(np.concatenate([dynamics.transition(self.root), gain], axis=1))
        else:
            moved = dynamics.mean(self._points(), time)
            deviations = moved[:, 1:] - moved[:, :1]
            shift = self._weight * tree_sum(transpose(deviations).copy())
            self.mean[...] = moved[:, 0] + shift
            deviations -= self._share * shift[:, None]
            deviations *= math.sqrt(self._weight)
            self.root[...] = triangularise(np.concatenate([deviations, gain], axis=1))
            self._take_excess(self.root, shift)
        self.covariance[...] = lower_gram(self.root)

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """The equations of the module's head."""
        suite = self.models.suite
        n, m, size = len(self.mean), suite.size, self.mean.shape[1]
        differences = self._differences(measurement, poses)
        detected = self._silence(differences, detected)
        ahead, behind = differences[:, 1 : n + 1], differences[:, n + 1 :]
        half = math.sqrt(0.5 * self._weight)
        joint, leading = blank(self.root, (m + n, n, size)), zeros(self.root, (m + n, m, size))
        joint[:m], joint[m:] = half * (ahead - behind), self.root
        bends = ahead + behind
        shift = self._weight * tree_sum(transpose(bends).copy())
        bends -= 2.0 * self._share * shift[:, None]
        bends *= half
        leading[:m] = self._unexplained(suite.noise_root(detected), bends, shift)

        for scalar in range(m):
            rotate_in(leading[scalar:, scalar], joint[scalar:])
        residual = solve_lower(leading[:m], (differences[:, 0] - shift)[:, None])[:, 0]
        self.mean += tree_sum(transpose(leading[m:]) * residual[:, None])
        self.nis[...] = tree_sum(residual * residual)
        self.root[...] = joint[m:]
        self.covariance[...] = lower_gram(self.root)

    def _points(self) -> Array:
        return sigma_points(self.mean, math.sqrt(self._spread) * self.root)

    def _differences(self, measurement: Array, poses: list[Pose]) -> Array:
        """What was measured, then what each pair of sigma points would be, minus the centre's ``(m, 2n + 1, N)``."""
        suite = self.models.suite
        predicted = suite.measure(Scene(self._points(), self.models.layout, poses))
        centre = predicted[:, :1].copy()
        predicted[:, 0] = measurement
        predicted -= centre
        suite.wrap(predicted)
        return predicted

    def _silence(self, differences: Array, detected: BoolArray | None) -> BoolArray | None:
        """Which scalars are used ``(m, N)``, None for all; the others are made to differ nowhere.

        Such a scalar tells nothing and is explained by nothing.
        """
        used = detected
        if self.gate is not None:
            deviations = transpose(differences[:, 1:])
            shift = self._weight * tree_sum(deviations.copy())
            covariance = self._transform.moment(deviations, shift) + self.models.suite.noise_covariance
            used = self.admit(differences[:, 0] - shift, covariance, detected)
        if used is not None:
            differences[...] = np.where(used[:, None], differences, 0.0)
        return used

    def _unexplained(self, noise_root: Array, bends: Array, shift: Array) -> Array:
        """The block E and R^½ as one lower triangular root ``(m, m, N)``."""
        noise = np.broadcast_to(noise_root, (*noise_root.shape[:2], bends.shape[-1]))
        lower = triangularise(np.concatenate([noise, bends], axis=1))
        # More than noise cannot be surer than noise, whatever rounding says.
        np.maximum(diagonal(lower), diagonal(noise_root), out=diagonal(lower))
        self._take_excess(lower, shift)
        return lower

    def _take_excess(self, lower: Array, shift: Array) -> None:
        """Downdate by what the weight of the centre lies below its least; where that is too much, count a repair."""
        if self._excess:
            self.repairs += downdate(lower, self._excess * shift)

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Everything that makes up the track's state, by name, batch axis last."""
        return super().state_arrays() | {"root": self.root}
