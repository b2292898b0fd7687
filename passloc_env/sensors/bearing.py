"""Compass bearings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, Number
from passloc_env.faults import SOUND, Faults
from passloc_env.fields import count, option, part, quantity, vector
from passloc_env.sensors.sensor import Sensor, scalar_covariance
from passloc_env.sightline import Scene


@dataclass(frozen=True, kw_only=True)
class Bearing(Sensor):
    """Compass bearing of the emitter, ``θ = atan2(x, y)``, rad."""

    angular = (True,)

    sigma: Number = quantity("standard deviation", unit="rad", above=0)
    platform: int = count("index of the platform that carries it", 0)
    lever_arm: tuple[Number, ...] = vector("where on the platform, along its body axes", (), unit="m")
    detection_probability: Number = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)
    noise_law: str = option("how its errors are distributed", "gaussian", ("gaussian", "uniform"))
    faults: Faults = part(Faults, "what goes wrong", SOUND)

    @property
    def mean_squared_sine(self) -> Number:
        """``E sin² δ`` of its error δ: ``(1 − e^{−2σ²})/2``, or ``(1 − sin(2h)/(2h))/2`` for uniform errors up to h."""
        if self.noise_law == "uniform":
            doubled = 2.0 * np.sqrt(3.0) * self.sigma
            return 0.5 * (1.0 - np.sin(doubled) / doubled)
        return 0.5 * (1.0 - np.exp(-2.0 * np.square(self.sigma)))

    def undefined(self, scene: Scene) -> BoolArray:
        """Straight above or below too: from there every compass direction leads away."""
        nowhere: BoolArray = scene.sightline(self.platform, self.lever_arm).plumb
        return nowhere

    def measure(self, scene: Scene) -> Array:
        """``θ (1, …, N)``."""
        bearing: Array = scene.sightline(self.platform, self.lever_arm).bearing[None]
        return bearing

    def jacobian(self, scene: Scene) -> Array:
        """``∂θ/∂p = (cos θ, −sin θ)/ρ`` with ρ the horizontal range."""
        line = scene.sightline(self.platform, self.lever_arm)
        rows = scene.empty_jacobian(1)
        east, north = line.offset[0], line.offset[1]
        inverse = 1.0 / np.maximum(east * east + north * north, 1e-6)
        rows[0, 0] = north * inverse
        rows[0, 1] = -east * inverse
        return rows

    def noise_covariance(self) -> Array:
        """``σ² (1, 1, 1|N)``."""
        return scalar_covariance(self.sigma)
