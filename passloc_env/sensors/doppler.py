"""Doppler shifts."""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, Number
from passloc_env.faults import SOUND, Faults
from passloc_env.fields import count, part, quantity, vector
from passloc_env.nuisance import Nuisance
from passloc_env.sensors.sensor import Sensor, scalar_covariance
from passloc_env.sightline import Scene
from passloc_env.units import SPEED_OF_LIGHT


@dataclass(frozen=True, kw_only=True)
class Doppler(Sensor):
    """Doppler *shift* of the received carrier, ``f − f₀ = −f₀ ṙ/c``, Hz.

    The shift, not the frequency: at 1 GHz the frequency would lose seven digits. With ``carrier_sigma`` above zero the
    carrier is unknown: its offset from the nominal value becomes the nuisance state ``carrier_offset`` and the
    measurement is ``δ − (f₀ + δ) ṙ/c``.
    """

    sigma: Number = quantity("standard deviation", unit="Hz", above=0)
    carrier: Number = quantity("nominal carrier frequency", unit="Hz", above=0)
    carrier_sigma: Number = quantity(
        "prior standard deviation of the carrier; 0 when known", 0.0, unit="Hz", at_least=0
    )
    carrier_walk: Number = quantity("random walk of the carrier per step", 0.0, unit="Hz", at_least=0)
    propagation_speed: Number = quantity("speed of propagation", SPEED_OF_LIGHT, unit="m/s", above=0)
    platform: int = count("index of the platform that carries it", 0)
    lever_arm: tuple[Number, ...] = vector("where on the platform, along its body axes", (), unit="m")
    detection_probability: Number = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)
    faults: Faults = part(Faults, "what goes wrong", SOUND)

    @property
    def unknown_carrier(self) -> bool:
        """Whether the carrier is a nuisance state."""
        return not (isinstance(self.carrier_sigma, float) and self.carrier_sigma == 0.0)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The carrier's offset when it is unknown."""
        if not self.unknown_carrier:
            return ()
        return (Nuisance("carrier_offset", self.carrier_sigma, self.carrier_walk, unit="Hz"),)

    def measure(self, scene: Scene) -> Array:
        """The shift ``(1, …, N)``."""
        rate = scene.sightline(self.platform, self.lever_arm).range_rate
        if not self.unknown_carrier:
            shift: Array = rate * (-self.carrier / self.propagation_speed)
            return shift[None]
        offset = scene.nuisance("carrier_offset")
        shift = offset - (self.carrier + offset) * (rate / self.propagation_speed)
        return shift[None]

    def jacobian(self, scene: Scene) -> Array:
        """``−f/c (v_⊥/r, u)`` with ``v_⊥ = v − ṙu``, and ``1 − ṙ/c`` for the carrier's offset."""
        line = scene.sightline(self.platform, self.lever_arm)
        rows = scene.empty_jacobian(1)
        scale = -self.carrier / self.propagation_speed
        if self.unknown_carrier:
            scale = scale - scene.nuisance("carrier_offset") / self.propagation_speed
            row = scene.layout.nuisance_row("carrier_offset")
            rows[0, row] = 1.0 - line.range_rate / self.propagation_speed
        towards = line.direction
        rows[0, scene.layout.velocity] = scale * towards
        rows[0, scene.layout.position] = (scale * line.nearness) * (line.velocity - line.range_rate * towards)
        return rows

    def noise_covariance(self) -> Array:
        """``σ² (1, 1, 1|N)``."""
        return scalar_covariance(self.sigma)
