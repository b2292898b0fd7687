"""Phase differences between two antennas of an interferometer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from passloc_env.arrays import Array, Number
from passloc_env.errors import ScenarioError
from passloc_env.faults import SOUND, Faults
from passloc_env.fields import count, part, quantity, vector
from passloc_env.linalg import inner
from passloc_env.nuisance import Nuisance
from passloc_env.sensors.sensor import Sensor, scalar_covariance
from passloc_env.sightline import Scene
from passloc_env.units import SPEED_OF_LIGHT

_ROTATIONS = ("roll", "pitch", "yaw")


@dataclass(frozen=True, kw_only=True)
class PhaseDifference(Sensor):
    """Phase by which the antenna along a body axis leads, ``φ = (2π d f/c) m·u``, rad (paper 001, eq. 1).

    ``m`` is the body axis and ``u`` the direction to the emitter. The phase is taken as unambiguous, as by several
    baselines. With ``misalignment_sigma`` above zero the body is turned by a small, constant, unknown rotation ε about
    its own axes: three nuisance states per platform, shared by its interferometers, and ``m`` becomes ``m + ε × m``.
    """

    sigma: Number = quantity("standard deviation", unit="rad", above=0)
    axis: int = count("body axis that the baseline lies along: 0 forward, 1 starboard, 2 down", 0)
    baseline: Number = quantity("distance of the antennas", unit="m", above=0)
    carrier: Number = quantity("carrier frequency", unit="Hz", above=0)
    propagation_speed: Number = quantity("speed of propagation", SPEED_OF_LIGHT, unit="m/s", above=0)
    misalignment_sigma: Number = quantity(
        "prior standard deviation of the body's misalignment about each axis; 0 when known", 0.0, unit="rad", at_least=0
    )
    platform: int = count("index of the platform that carries it", 0)
    lever_arm: tuple[Number, ...] = vector("where on the platform, along its body axes", (), unit="m")
    detection_probability: Number = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)
    faults: Faults = part(Faults, "what goes wrong", SOUND)

    @property
    def misaligned(self) -> bool:
        """Whether the body's misalignment is a nuisance state."""
        return not (isinstance(self.misalignment_sigma, float) and self.misalignment_sigma == 0.0)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The misalignment about each body axis when it is unknown."""
        return self.nuisance_claims if self.misaligned else ()

    @property
    def nuisance_claims(self) -> tuple[Nuisance, ...]:
        """The body that carries it is one: either its misalignment is known to all interferometers, or to none."""
        names = (f"{rotation}_error_{self.platform}" for rotation in _ROTATIONS)
        return tuple(Nuisance(name, self.misalignment_sigma, unit="rad") for name in names)

    def check(self, dimension: int) -> None:
        """The axis exists, and misalignments are those of space."""
        if self.axis >= dimension:
            raise ScenarioError("axis", self.axis, f"must be below {dimension}, the number of axes")
        if self.misaligned and dimension != 3:
            raise ScenarioError("misalignment_sigma", self.misalignment_sigma, "must be 0 in the plane")

    @property
    def radians_per_cosine(self) -> Number:
        """``2π d f/c``: how many radians a direction cosine of one means."""
        return 2.0 * math.pi * self.baseline * self.carrier / self.propagation_speed

    def measure(self, scene: Scene) -> Array:
        """``φ (1, …, N)``."""
        towards = scene.sightline(self.platform, self.lever_arm).direction
        phase: Array = self.radians_per_cosine * inner(self._baseline_axis(scene), towards)
        return phase[None]

    def jacobian(self, scene: Scene) -> Array:
        """``n (m − (m·u) u)/r`` for the position, ``n (b_i × m)·u`` for the misalignment about axis i."""
        line = scene.sightline(self.platform, self.lever_arm)
        axis, towards, scale = self._baseline_axis(scene), line.direction, self.radians_per_cosine
        rows = scene.empty_jacobian(1)
        rows[0, scene.layout.position] = (scale / line.range) * (axis - inner(axis, towards) * towards)
        if self.misaligned:
            body = self._body_axes(scene)
            for name, sign, other in self._tilts():
                rows[0, scene.layout.nuisance_row(name)] = scale * sign * inner(body[other], towards)
        return rows

    def noise_covariance(self) -> Array:
        """``σ² (1, 1, 1|N)``."""
        return scalar_covariance(self.sigma)

    def _body_axes(self, scene: Scene) -> Array:
        """Reported body axes as rows ``(d, d, 1 …, N)``, ready to meet the middle axes of the scene."""
        attitude = scene.poses[self.platform].attitude
        middle: tuple[Any, ...] = (slice(None), slice(None), *(None,) * (scene.state.ndim - 2))
        axes: Array = attitude[middle]
        return axes

    def _baseline_axis(self, scene: Scene) -> Array:
        """``m + ε × m``, ``(d, 1 | …, N)``."""
        body = self._body_axes(scene)
        axis: Array = body[self.axis]
        if self.misaligned:
            for name, sign, other in self._tilts():
                axis = axis + (sign * scene.nuisance(name)) * body[other]
        return axis

    def _tilts(self) -> list[tuple[str, float, int]]:
        """The two rotations that move the axis: nuisance, sign, and the body axis it moves towards.

        ``b_i × b_{i+1} = b_{i+2}``: a rotation about the axis before this one moves it towards the axis after it.
        """
        before, after = (self.axis + 2) % 3, (self.axis + 1) % 3
        return [
            (f"{_ROTATIONS[before]}_error_{self.platform}", 1.0, after),
            (f"{_ROTATIONS[after]}_error_{self.platform}", -1.0, before),
        ]
