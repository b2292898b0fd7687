"""The emitter: where it starts and how it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passloc_env.angles import direction
from passloc_env.arrays import Array, Number
from passloc_env.component import Component
from passloc_env.errors import ScenarioError
from passloc_env.fields import abstract, part, quantity, vector
from passloc_env.frames import from_geodetic, local_axes
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.platforms import stack


@abstract
class Start(Component):
    """Base of initial geometries."""

    dimension: int = 2

    def sample(self, environments: int) -> Array:
        """Initial position, velocity and, where it is given, acceleration ``(2d | 3d, N)`` of a realised start."""
        raise AssertionError(f"{type(self).__name__} must define sample")


@dataclass(frozen=True, kw_only=True)
class PolarStart(Start):
    """Range and bearing from the origin, speed and course; planar.

    An acceleration along the course counts for motions that hold it as a state.
    """

    range: Number = quantity("distance from the origin", unit="m", above=0)
    bearing: Number = quantity("bearing from the origin, clockwise from north", 0.0, unit="rad")
    speed: Number = quantity("speed", 0.0, unit="m/s", at_least=0)
    course: Number = quantity("course, clockwise from north", 0.0, unit="rad")
    acceleration: Number = quantity("acceleration along the course", 0.0, unit="m/s²")

    def sample(self, environments: int) -> Array:
        """East, north, their rates and accelerations ``(6, N)``."""
        values = (self.range, self.bearing, self.speed, self.course, self.acceleration)
        distance, bearing, speed, course, push = stack(values, environments)
        ahead = direction(course)
        return np.concatenate([distance * direction(bearing), speed * ahead, push * ahead])


@dataclass(frozen=True, kw_only=True)
class CartesianStart(Start):
    """Position and velocity by axis, in as many dimensions as there are axes.

    An acceleration counts for motions that hold it as a state.
    """

    position: tuple[Number, ...] = vector("position by axis", unit="m")
    velocity: tuple[Number, ...] = vector("velocity by axis", unit="m/s")
    acceleration: tuple[Number, ...] = vector("acceleration by axis; empty for none", (), unit="m/s²")

    @property
    def dimension(self) -> int:  # type: ignore[override]
        """Number of axes."""
        return len(self.position)

    def validate(self) -> None:
        """Both must have the same two or three axes."""
        if len(self.position) not in (2, 3):
            raise ScenarioError("position", self.position, "must have 2 or 3 axes")
        if len(self.velocity) != len(self.position):
            raise ScenarioError("velocity", self.velocity, f"must have {len(self.position)} axes like the position")
        if len(self.acceleration) not in (0, len(self.position)):
            allowed = f"must be empty or have {len(self.position)} axes like the position"
            raise ScenarioError("acceleration", self.acceleration, allowed)

    def sample(self, environments: int) -> Array:
        """Position, velocity and, where it is given, acceleration ``(2d | 3d, N)``."""
        return stack(self.position + self.velocity + self.acceleration, environments)


@dataclass(frozen=True, kw_only=True)
class GeodeticStart(Start):
    """A place above the WGS-84 ellipsoid and a level course over ground, in the Earth-centred frame (ECEF)."""

    dimension = 3

    latitude: Number = quantity("geodetic latitude", unit="rad", at_least=-math.pi / 2, at_most=math.pi / 2)
    longitude: Number = quantity("longitude", unit="rad")
    height: Number = quantity("height above the ellipsoid", 0.0, unit="m", at_least=-1e3)
    speed: Number = quantity("speed over ground", 0.0, unit="m/s", at_least=0)
    course: Number = quantity("course over ground, clockwise from north", 0.0, unit="rad")

    def sample(self, environments: int) -> Array:
        """Position and velocity in ECEF ``(6, N)``."""
        values = (self.latitude, self.longitude, self.height, self.speed, self.course)
        latitude, longitude, height, speed, course = stack(values, environments)
        east, north, _ = local_axes(latitude, longitude)
        velocity = speed * (np.sin(course) * east + np.cos(course) * north)
        return np.concatenate([from_geodetic(latitude, longitude, height), velocity])


@dataclass(frozen=True, kw_only=True)
class Target(Component):
    """The emitter as it truly is."""

    start: Start = part(Start, "where it starts and how fast it goes")
    motion: Motion = part(Motion, "how it moves from there", ConstantVelocity())
