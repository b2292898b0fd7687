"""What is known before tracking begins: the prior from which every tracker starts and every bound counts.

A prior is drawn once per episode from the first measurement (and, where a scenario says that intelligence about the
emitter exists, from numbers scattered around the truth). Evaluated at the truth it is the ``J₀⁻¹`` of the bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.angles import bearing_of, direction
from passloc_env.arrays import Array, BoolArray, Number, zeros
from passloc_env.component import Component
from passloc_env.errors import ScenarioError
from passloc_env.fields import abstract, count, quantity
from passloc_env.layout import StateLayout
from passloc_env.nuisance import Nuisance
from passloc_env.platforms import Platform, Pose
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, Sensor

THINNEST = 1e-7
"""Cross-range uncertainty as a share of that in range, at least: a Cartesian covariance in doubles holds no thinner."""


@dataclass
class FirstLook:
    """What a prior is made from.

    Attributes:
        layout: the state to fill.
        truth: the true state in that layout ``(n, N)``.
        measurement: the first measurement ``(m, N)``.
        suite: the sensors that made it.
        poses: reported pose of every platform.
        normals: standard normals ``(p, N)`` for what is scattered around the truth.
        nuisances: the nuisance states of the layout.
        carrier: the platform that the prior starts from.
        detected: which scalars ``(m, N)`` were measured; None means all.
    """

    layout: StateLayout
    truth: Array
    measurement: Array
    suite: SensorSuite
    poses: list[Pose]
    normals: Array
    nuisances: tuple[Nuisance, ...]
    carrier: int = 0
    detected: BoolArray | None = None

    @property
    def pose(self) -> Pose:
        """Reported pose of the platform that the prior starts from."""
        return self.poses[self.carrier]


@abstract
class Prior(Component):
    """Base of priors."""

    normals: int = 0
    """Standard normals it needs per episode for a 2-D state; see :meth:`normals_needed`."""

    def normals_needed(self, layout: StateLayout) -> int:
        """Standard normals it needs per episode."""
        return self.normals

    def carrier_platform(self, sensors: tuple[Sensor, ...]) -> int:
        """The platform whose pose the prior starts from."""
        return 0

    def check(self, sensors: tuple[Sensor, ...], platforms: tuple[Platform, ...], dimension: int) -> None:
        """Raise ScenarioError when the prior does not fit the scenario."""

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """Mean ``(n, N)`` and covariance ``(n, n, N)`` of the tracker's first belief."""
        raise AssertionError(f"{type(self).__name__} must define start")

    def at_truth(self, look: FirstLook) -> Array:
        """Covariance ``(n, n, N)`` evaluated at the truth, for the bound."""
        raise AssertionError(f"{type(self).__name__} must define at_truth")


@abstract
class BearingPrior(Prior):
    """Base of priors that take their direction from the first bearing (planar problems).

    Tracking begins with the first detection: the look that a prior is made from is heard, whatever the sensor's
    ``detection_probability``.
    """

    sensor: int

    def carrier_platform(self, sensors: tuple[Sensor, ...]) -> int:
        """The platform that carries the bearing sensor."""
        return sensors[self.sensor].platform

    def check(self, sensors: tuple[Sensor, ...], platforms: tuple[Platform, ...], dimension: int) -> None:
        """The sensor named must be a bearing, and the problem planar."""
        if self.sensor >= len(sensors) or not isinstance(sensors[self.sensor], Bearing):
            bearings = [i for i, sensor in enumerate(sensors) if isinstance(sensor, Bearing)]
            raise ScenarioError("sensor", self.sensor, f"must be the index of a Bearing sensor; here {bearings}")
        if dimension != 2:
            raise ScenarioError("sensor", self.sensor, "a prior from a bearing needs a planar scenario")

    def _first_bearing(self, look: FirstLook) -> tuple[Array, Array]:
        """The measured bearing ``(N,)`` and its standard deviation ``(1 | N,)``."""
        row = look.suite.rows[self.sensor].start
        sigma: Array = np.sqrt(look.suite.noise_covariance[row, row])
        return look.measurement[row], sigma

    def _origin(self, look: FirstLook) -> Array:
        """Where the bearing is taken ``(2, N)``."""
        return look.pose.mounted(look.suite.sensors[self.sensor].lever_arm).position

    def _truth_seen(self, look: FirstLook) -> tuple[Array, Array]:
        """True bearing and range ``(N,)``."""
        offset = look.truth[look.layout.position] - self._origin(look)
        return bearing_of(offset), np.hypot(offset[0], offset[1])


def polar_covariance(bearing: Array, along: Number, across: Number) -> Array:
    """Covariance ``(2, 2, N)`` with standard deviations ``along`` a compass bearing and ``across`` it."""
    u = direction(bearing)
    t = np.stack([u[1], -u[0]])
    along_part = np.square(along) * (u[:, None] * u[None])
    covariance: Array = along_part + np.square(across) * (t[:, None] * t[None])
    return covariance


def blank(look: FirstLook, acceleration_sigma: Number, environments: int) -> tuple[Array, Array]:
    """Zero mean, and a covariance with only accelerations and nuisances filled in."""
    layout = look.layout
    mean = zeros(look.truth, (layout.size, environments))
    covariance = zeros(look.truth, (layout.size, layout.size, environments))
    for row in range(layout.acceleration.start, layout.acceleration.stop):
        covariance[row, row] = np.square(acceleration_sigma)
    for nuisance in look.nuisances:
        row = layout.nuisance_row(nuisance.name)
        covariance[row, row] = np.square(nuisance.sigma)
    return mean, covariance


@abstract
class CourselessPrior(BearingPrior):
    """Base of bearing priors that know nothing of a course: the velocity is as uncertain along every axis."""

    range_sigma: Number
    velocity_sigma: Number
    acceleration_sigma: Number

    def at_truth(self, look: FirstLook) -> Array:
        """At the true bearing, with the cross-range uncertainty of the true range."""
        _, sigma = self._first_bearing(look)
        bearing, distance = self._truth_seen(look)
        return self._spread(look, bearing, distance * sigma)[1]

    def _spread(self, look: FirstLook, bearing: Array, across: Array) -> tuple[Array, Array]:
        mean, covariance = blank(look, self.acceleration_sigma, len(bearing))
        layout, wide = look.layout, np.maximum(across, THINNEST * self.range_sigma)
        covariance[layout.position, layout.position] = polar_covariance(bearing, self.range_sigma, wide)
        for row in range(layout.velocity.start, layout.velocity.stop):
            covariance[row, row] = np.square(self.velocity_sigma)
        return mean, covariance


@dataclass(frozen=True, kw_only=True)
class RangePrior(CourselessPrior):
    """A broad guess: somewhere along the first bearing, with any velocity.

    ``p = own + r u(θ₁)``, ``cov = σ_r² u uᵀ + (r σ_θ)² t tᵀ``, ``v = 0 ± σ_v`` per axis.
    """

    range: Number = quantity("expected range", unit="m", above=0)
    range_sigma: Number = quantity("standard deviation of the range", unit="m", above=0)
    velocity_sigma: Number = quantity("standard deviation of the velocity per axis", unit="m/s", above=0)
    acceleration_sigma: Number = quantity("standard deviation of the acceleration per axis", 1.0, unit="m/s²", above=0)
    sensor: int = count("index of the bearing sensor", 0)

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """Centred on the first measured bearing."""
        bearing, sigma = self._first_bearing(look)
        mean, covariance = self._spread(look, bearing, self.range * sigma)
        mean[look.layout.position] = self._origin(look) + self.range * direction(bearing)
        return mean, covariance


@dataclass(frozen=True, kw_only=True)
class CoursePrior(BearingPrior):
    """An estimate of range and speed, and the guess that the emitter is heading towards us.

    Range and speed are drawn around the truth (never below their minima); the course is the first bearing + 180°.
    Standard deviations are polar, for position (σ_r, r σ_θ) and velocity (σ_speed, speed σ_course), turned into a
    Cartesian covariance (the own-ship cases of *Beyond the Kalman Filter*, ch. 6). At the truth: the true bearing,
    range and speed, and the same inbound course.
    """

    normals = 2

    range_sigma: Number = quantity("standard deviation of the range", unit="m", above=0)
    speed_sigma: Number = quantity("standard deviation of the speed", unit="m/s", above=0)
    course_sigma: Number = quantity("standard deviation of the course", unit="rad", above=0)
    min_range: Number = quantity("smallest range ever drawn", 600.0, unit="m", above=0)
    min_speed: Number = quantity("smallest speed ever drawn", 0.3, unit="m/s", above=0)
    acceleration_sigma: Number = quantity("standard deviation of the acceleration per axis", 0.01, unit="m/s²", above=0)
    sensor: int = count("index of the bearing sensor", 0)

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """Centred on the first measured bearing and the drawn range and speed."""
        bearing, sigma = self._first_bearing(look)
        _, true_range = self._truth_seen(look)
        distance = np.maximum(true_range + self.range_sigma * look.normals[0], self.min_range)
        speed = np.maximum(_speed(look) + self.speed_sigma * look.normals[1], self.min_speed)
        mean, covariance = self._spread(look, bearing, distance * sigma, speed)
        mean[look.layout.position] = self._origin(look) + distance * direction(bearing)
        mean[look.layout.velocity] = speed * direction(bearing + np.pi)
        return mean, covariance

    def at_truth(self, look: FirstLook) -> Array:
        """At the true bearing, range and speed."""
        _, sigma = self._first_bearing(look)
        bearing, distance = self._truth_seen(look)
        return self._spread(look, bearing, distance * sigma, _speed(look))[1]

    def _spread(self, look: FirstLook, bearing: Array, across: Array, speed: Array) -> tuple[Array, Array]:
        mean, covariance = blank(look, self.acceleration_sigma, len(bearing))
        layout = look.layout
        covariance[layout.position, layout.position] = polar_covariance(bearing, self.range_sigma, across)
        turning = polar_covariance(bearing, self.speed_sigma, speed * self.course_sigma)
        covariance[layout.velocity, layout.velocity] = turning
        return mean, covariance


def _speed(look: FirstLook) -> Array:
    velocity = look.truth[look.layout.velocity]
    return np.hypot(velocity[0], velocity[1])


@dataclass(frozen=True, kw_only=True)
class StatePrior(Prior):
    """A guess drawn around the true state, independent per axis; any number of dimensions."""

    position_sigma: Number = quantity("standard deviation of the position per axis", unit="m", above=0)
    velocity_sigma: Number = quantity("standard deviation of the velocity per axis", unit="m/s", above=0)
    acceleration_sigma: Number = quantity("standard deviation of the acceleration per axis", 1.0, unit="m/s²", above=0)

    def normals_needed(self, layout: StateLayout) -> int:
        """One per kinematic state."""
        return layout.kinematic.stop

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """Centred on the truth plus a draw from the covariance."""
        layout = look.layout
        covariance = self.at_truth(look)
        mean = zeros(look.truth, (layout.size, covariance.shape[-1]))
        for row in range(layout.kinematic.stop):
            mean[row] = look.truth[row] + np.sqrt(covariance[row, row]) * look.normals[row]
        return mean, covariance

    def at_truth(self, look: FirstLook) -> Array:
        """The same everywhere."""
        layout = look.layout
        _, covariance = blank(look, self.acceleration_sigma, look.truth.shape[-1])
        for block, sigma in ((layout.position, self.position_sigma), (layout.velocity, self.velocity_sigma)):
            for row in range(block.start, block.stop):
                covariance[row, row] = np.square(sigma)
        return covariance
