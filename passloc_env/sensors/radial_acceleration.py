"""Radial accelerations, as heard in the rate of a carrier or of a pulse repetition frequency."""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, Number
from passloc_env.faults import SOUND, Faults
from passloc_env.fields import count, part, quantity, vector
from passloc_env.sensors.sensor import Sensor, scalar_covariance
from passloc_env.sightline import Scene


@dataclass(frozen=True, kw_only=True)
class RadialAcceleration(Sensor):
    """Second derivative of the range, ``r̈ = (v² − ṙ²)/r + u·a``, m/s².

    ``v`` and ``a`` are the emitter's velocity and acceleration relative to the *moving* sensor: the observer's own
    acceleration is part of what it hears, and a turning aircraft's 13 m/s² dwarfs a signal of 0.5. An emitter's
    acceleration counts where it is a state. For an emitter on a straight track and an observer at rest this is
    ``D² v²/r³`` (paper 002, eq. 4).
    """

    sigma: Number = quantity("standard deviation", unit="m/s²", above=0)
    platform: int = count("index of the platform that carries it", 0)
    lever_arm: tuple[Number, ...] = vector("where on the platform, along its body axes", (), unit="m")
    detection_probability: Number = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)
    faults: Faults = part(Faults, "what goes wrong", SOUND)

    def measure(self, scene: Scene) -> Array:
        """``r̈ (1, …, N)``."""
        acceleration: Array = scene.sightline(self.platform, self.lever_arm).range_acceleration[None]
        return acceleration

    def jacobian(self, scene: Scene) -> Array:
        """``∂/∂p = (a − r̈ u − 2 ṙ v_⊥/r)/r``, ``∂/∂v = 2 v_⊥/r``, ``∂/∂a = u``, with ``v_⊥ = v − ṙ u``."""
        line = scene.sightline(self.platform, self.lever_arm)
        towards = line.direction
        across = line.velocity - line.range_rate * towards
        rows = scene.empty_jacobian(1)
        turning = line.acceleration - line.range_acceleration * towards - (2.0 * line.range_rate / line.range) * across
        rows[0, scene.layout.position] = turning / line.range
        rows[0, scene.layout.velocity] = (2.0 / line.range) * across
        if scene.layout.order > 1:
            rows[0, scene.layout.acceleration] = towards
        return rows

    def noise_covariance(self) -> Array:
        """``σ² (1, 1, 1|N)``."""
        return scalar_covariance(self.sigma)
