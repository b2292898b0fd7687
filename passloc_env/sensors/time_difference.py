"""Differences of the times at which a pulse arrives at two platforms."""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, Number
from passloc_env.errors import ScenarioError
from passloc_env.faults import SOUND, Faults
from passloc_env.fields import count, part, quantity, vector
from passloc_env.sensors.sensor import Sensor, scalar_covariance
from passloc_env.sightline import Scene
from passloc_env.units import SPEED_OF_LIGHT


@dataclass(frozen=True, kw_only=True)
class TimeDifference(Sensor):
    """How much later a pulse reaches the other platform, ``τ = (r_other − r)/c``, s (paper 001, eq. 2)."""

    sigma: Number = quantity("standard deviation", unit="s", above=0)
    platform: int = count("index of the first platform", 0)
    other: int = count("index of the other platform", 1)
    lever_arm: tuple[Number, ...] = vector("where on the first platform, along its body axes", (), unit="m")
    other_lever_arm: tuple[Number, ...] = vector("where on the other platform", (), unit="m")
    propagation_speed: Number = quantity("speed of propagation", SPEED_OF_LIGHT, unit="m/s", above=0)
    detection_probability: Number = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)
    faults: Faults = part(Faults, "what goes wrong", SOUND)

    def validate(self) -> None:
        """The two places must differ."""
        if self.platform == self.other and self.lever_arm == self.other_lever_arm:
            raise ScenarioError("other", self.other, "must be another platform, or another place on the same one")

    @property
    def places(self) -> tuple[tuple[int, tuple[Number, ...]], ...]:
        """Both."""
        return (self.platform, self.lever_arm), (self.other, self.other_lever_arm)

    def check(self, dimension: int) -> None:
        """The other lever arm has as many axes as the problem."""
        if len(self.other_lever_arm) not in (0, dimension):
            raise ScenarioError("other_lever_arm", self.other_lever_arm, f"must be empty or have {dimension} axes")

    def measure(self, scene: Scene) -> Array:
        """``τ (1, …, N)``."""
        first = scene.sightline(self.platform, self.lever_arm)
        other = scene.sightline(self.other, self.other_lever_arm)
        later: Array = (other.range - first.range) / self.propagation_speed
        return later[None]

    def jacobian(self, scene: Scene) -> Array:
        """``∂τ/∂p = (u_other − u)/c``."""
        first = scene.sightline(self.platform, self.lever_arm)
        other = scene.sightline(self.other, self.other_lever_arm)
        rows = scene.empty_jacobian(1)
        rows[0, scene.layout.position] = (other.direction - first.direction) / self.propagation_speed
        return rows

    def noise_covariance(self) -> Array:
        """``σ² (1, 1, 1|N)``."""
        return scalar_covariance(self.sigma)
