"""The extended Kalman filter, batched.

The measurement is taken as linear at the prediction, with the sensors' own Jacobian ``H``:

    S = H P Hᵀ + R,   K = P Hᵀ S⁻¹,   x ← x + K (z − h(x)),   P ← P − K S Kᵀ

(Bar-Shalom, Li & Kirubarajan, *Estimation with Applications*, 10.3). A third of the unscented filter's work, and as
good where the belief is narrow compared with the curvature of the measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, BoolArray, blank
from passloc_env.errors import ScenarioError
from passloc_env.fields import part
from passloc_env.linalg import cholesky, matmul, transpose
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.platforms import Pose
from passloc_env.sightline import Scene
from passloc_env.tracking.correction import correct, repair
from passloc_env.tracking.gating import gate_of, gate_probability
from passloc_env.tracking.tracker import Models, Track, Tracker


@dataclass(frozen=True, kw_only=True)
class ExtendedKalman(Tracker):
    """Extended Kalman filter; linear motions, any sensors."""

    motion: Motion = part(Motion, "how it believes the emitter moves", ConstantVelocity())
    gate: float = gate_probability()

    def validate(self) -> None:
        """Nonlinear motions have no transition matrix."""
        if not self.motion.linear:
            allowed = "must be a linear motion; UnscentedKalman takes any"
            raise ScenarioError("motion", type(self.motion).__name__, allowed)

    def build(self, models: Models, environments: int) -> ExtendedTrack:
        """The running filter."""
        return ExtendedTrack(self, models, environments)


class ExtendedTrack(Track):
    """The running filter of a batch."""

    def __init__(self, filter_: ExtendedKalman, models: Models, environments: int) -> None:
        super().__init__(models, environments)
        self.gate = gate_of(filter_.gate, models.suite)

    def predict(self, time: Array) -> None:
        """``x ← F x + B u``, ``P ← F P Fᵀ + Q``."""
        self.models.dynamics.advance(self.mean, time)
        self.models.dynamics.spread(self.covariance)

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """The equations of the module's head."""
        suite = self.models.suite
        n = len(self.mean)
        if not cholesky(self.covariance).sound:
            repair(self)
        scene = Scene(self.mean, self.models.layout, poses)
        rows = suite.jacobian(scene)
        right = blank(self.mean, (suite.size, n + 1, self.mean.shape[1]))
        right[:, :n] = matmul(rows, self.covariance)
        right[:, n] = suite.difference(measurement, suite.measure(scene))
        innovation_covariance = matmul(right[:, :n], transpose(rows)) + suite.noise_covariance
        used = self.admit(right[:, n], innovation_covariance, detected)
        correct(self, right, innovation_covariance, suite.noise_pivots, used)
