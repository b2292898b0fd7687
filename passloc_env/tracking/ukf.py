"""The unscented Kalman filter, batched; its equations are those of :mod:`passloc_env.tracking.unscented`."""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, BoolArray
from passloc_env.fields import part, quantity
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.platforms import Pose
from passloc_env.tracking.gating import gate_of, gate_probability
from passloc_env.tracking.tracker import Models, Track, Tracker
from passloc_env.tracking.unscented import UnscentedTransform


@dataclass(frozen=True, kw_only=True)
class UnscentedKalman(Tracker):
    """Unscented Kalman filter with scaled sigma points; any motion, any sensors."""

    motion: Motion = part(Motion, "how it believes the emitter moves", ConstantVelocity())
    alpha: float = quantity("spread of the sigma points", 1.0, above=0, plain=True)
    beta: float = quantity("weight of the centre in the covariance; 2 suits a Gaussian", 2.0, plain=True)
    kappa: float = quantity("secondary spread", 0.0, plain=True)
    gate: float = gate_probability()

    def build(self, models: Models, environments: int) -> Track:
        """The running filter; ScenarioError when kappa leaves no spread in this state size."""
        return UnscentedTrack(self, models, environments)

    def transform(self, states: int) -> UnscentedTransform:
        """Its sigma points for so many states; ScenarioError when kappa leaves no spread."""
        return UnscentedTransform(states, self.alpha, self.beta, self.kappa)


class UnscentedTrack(Track):
    """The running filter of a batch."""

    def __init__(self, filter_: UnscentedKalman, models: Models, environments: int) -> None:
        super().__init__(models, environments)
        self._transform = filter_.transform(models.layout.size)
        self.gate = gate_of(filter_.gate, models.suite)

    def predict(self, time: Array) -> None:
        """``x ← f(x)``, ``P ← F P Fᵀ + Q`` or its sigma-point form."""
        self._transform.predict(self, self.models.dynamics, time)

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """The unscented correction."""
        self._transform.update(self, self.models, measurement, poses, detected, self.admit)
