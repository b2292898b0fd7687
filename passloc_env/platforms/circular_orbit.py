"""Satellites on circular orbits, seen in the rotating Earth-centred frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from passloc_env.arrays import Array, BoolArray, Number, rows, zeros
from passloc_env.fields import quantity
from passloc_env.frames import EARTH_GRAVITY, EARTH_RADIUS, EARTH_RATE, below_horizon, cross, turned_body
from passloc_env.lazy import lazy
from passloc_env.linalg import matmul, transpose, tree_sum
from passloc_env.noise import NavigationErrors
from passloc_env.platforms.platform import Platform, stack
from passloc_env.platforms.pose import Pose

_LATITUDE, _NODE = 0, 1
_ATTITUDE = slice(2, 11)
_RATES = slice(11, 14)


@dataclass(frozen=True, kw_only=True)
class CircularOrbit(Platform):
    """A satellite on a circular orbit, its interferometer bolted to the body.

    The orbital frame is geocentric: X along the inertial velocity, Z to the Earth's centre, Y = Z × X (starboard). The
    body starts aligned with it. With a ``max_body_rate`` three actions in [-1, 1] are the body's rates of roll, pitch
    and yaw relative to the orbital frame, in units of that rate; without, the body keeps pointing down and takes none.

    The attitude is *reported* with errors about the body axes: white from step to step (``attitude_sigma``), constant
    throughout an episode (``attitude_bias_sigma``), or both; neither tracker nor agent knows them.
    """

    dimension = 3
    set_points = 3

    altitude: Number = quantity("height above the equatorial radius", 700e3, unit="m", above=100e3)
    inclination: Number = quantity("inclination of the orbit", 1.0471975511965976, unit="rad", at_least=0)
    argument_of_latitude: Number = quantity("angle from the ascending node at the start", 0.0, unit="rad")
    node_longitude: Number = quantity("longitude of the ascending node at the start", 0.0, unit="rad")
    max_body_rate: float = quantity(
        "largest body rate; 0 for a body that keeps pointing down", 0.0, unit="rad/s", at_least=0, plain=True
    )
    attitude_sigma: Number = quantity("attitude error about each axis, white", 0.0, unit="rad", at_least=0)
    attitude_bias_sigma: Number = quantity("attitude error about each axis, constant", 0.0, unit="rad", at_least=0)

    @property
    def controls(self) -> int:  # type: ignore[override]
        """Three body rates, or none."""
        return 3 if self.max_body_rate > 0.0 else 0

    @property
    def steers_body(self) -> bool:  # type: ignore[override]
        """Whether it takes body rates."""
        return self.controls > 0

    @property
    def constant_errors(self) -> int:  # type: ignore[override]
        """One per axis when the attitude is biased."""
        return _one_per_axis(self.attitude_bias_sigma)

    @property
    def fresh_errors(self) -> int:  # type: ignore[override]
        """One per axis when the attitude is noisy."""
        return _one_per_axis(self.attitude_sigma)

    @property
    def radius(self) -> Number:
        """Distance from the Earth's centre, m."""
        return EARTH_RADIUS + self.altitude

    @property
    def orbital_rate(self) -> Number:
        """Angular rate along the orbit, rad/s: ``√(μ/a³)``."""
        return np.sqrt(EARTH_GRAVITY / self.radius**3)

    def start(self, environments: int) -> Array:
        """Argument of latitude, node longitude, body axes in the orbital frame by row, body rates ``(14, N)``."""
        aligned = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        return stack((self.argument_of_latitude, self.node_longitude, *aligned, 0.0, 0.0, 0.0), environments)

    def state_at(self, pose: Pose) -> Array:
        """The orbit's angles from position and velocity, the body axes from the attitude; body rates of zero."""
        up = pose.position / self.radius
        forward = (pose.velocity + _earth_turn(pose.position)) / (self.radius * self.orbital_rate)
        latitude = np.arctan2(up[2], forward[2])
        node = np.arctan2(up[1], up[0]) - np.arctan2(np.sin(latitude) * np.cos(self.inclination), np.cos(latitude))
        still = np.zeros((14, len(node)))
        still[_LATITUDE], still[_NODE] = latitude, node
        orbital = rows(forward, cross(-up, forward), -up)
        still[_ATTITUDE] = matmul(pose.attitude, transpose(orbital)).reshape(9, -1)
        return still

    def set_point(self, state: Array, action: Array, line_of_sight: Array) -> Array:
        """Body rates ``(3, N)``, rad/s."""
        return action * self.max_body_rate

    def move(self, state: Array, set_point: Array, period: float) -> Array:
        """Along the orbit, while the Earth turns below and the body at its rates; exact for any period."""
        moved = state.copy()
        moved[_LATITUDE] += self.orbital_rate * period
        moved[_NODE] -= EARTH_RATE * period
        if self.controls:
            axes = state[_ATTITUDE].reshape(3, 3, -1)
            moved[_ATTITUDE] = turned_body(axes, set_point * period).reshape(9, -1)
            moved[_RATES] = set_point
        return moved

    def pose(self, state: Array) -> OrbitPose:
        """The true pose in ECEF."""
        return OrbitPose(self, state)

    def reported_pose(self, state: Array, pose: Pose, errors: NavigationErrors) -> Pose:
        """The true position and velocity, and the attitude with its errors."""
        if not self.constant_errors and not self.fresh_errors:
            return pose
        rotation = zeros(state, (3, state.shape[-1]))
        if self.constant_errors:
            rotation += self.attitude_bias_sigma * errors.constant
        if self.fresh_errors:
            rotation += self.attitude_sigma * errors.fresh
        misread = state.copy()
        misread[_ATTITUDE] = turned_body(state[_ATTITUDE].reshape(3, 3, -1), rotation).reshape(9, -1)
        return OrbitPose(self, misread)


def _one_per_axis(sigma: Number) -> int:
    """Normals that an attitude error takes: three, or none when there is no such error."""
    return 0 if isinstance(sigma, float) and sigma == 0.0 else 3


class OrbitPose(Pose):
    """The pose of a satellite; acceleration and attitude are computed on first use."""

    def __init__(self, orbit: CircularOrbit, state: Array) -> None:
        self._orbit, self._state = orbit, state
        sine, cosine = np.sin(state[_LATITUDE]), np.cos(state[_LATITUDE])
        tilt_sine, tilt_cosine = np.sin(orbit.inclination), np.cos(orbit.inclination)
        self._up = _turned_east(rows(cosine, sine * tilt_cosine, sine * tilt_sine), state[_NODE])
        self._forward = _turned_east(rows(-sine, cosine * tilt_cosine, cosine * tilt_sine), state[_NODE])
        position = orbit.radius * self._up
        super().__init__(position, orbit.radius * orbit.orbital_rate * self._forward - _earth_turn(position))

    @classmethod
    def join(cls, poses: list[Any]) -> Pose:
        """The poses of several batches put end to end, with everything computed."""
        return Pose.join(poses)

    @lazy
    def acceleration(self) -> Array:
        """Gravity less the Coriolis and centrifugal parts ``(3, N)``, m/s²."""
        gravity = -(self._orbit.orbital_rate**2) * self.position
        return gravity - 2.0 * _earth_turn(self.velocity) - _earth_turn(_earth_turn(self.position))

    @lazy
    def attitude(self) -> Array:
        """Body axes as rows ``(3, 3, N)``: forward, starboard, down."""
        down = -self._up
        return self._body(rows(self._forward, cross(down, self._forward), down))

    @lazy
    def attitude_rate(self) -> Array:
        """Time derivative of the axes: the orbit's turn, the body's own, less the Earth's; rad/s."""
        rate = self._orbit.orbital_rate
        carried = self._body(rows(-rate * self._up, zeros(self._up, self._up.shape), -rate * self._forward))
        body = self.attitude
        spin = tree_sum(self._state[_RATES][:, None] * body)
        return rows(*(carried[i] + cross(spin, body[i]) - _earth_turn(body[i]) for i in range(3)))

    def _body(self, orbital: Array) -> Array:
        """Body axes from their components along orbital axes ``(3, 3, N)``."""
        return matmul(self._state[_ATTITUDE].reshape(3, 3, -1), orbital)

    def hidden(self, point: Array) -> BoolArray | None:
        """Which points ``(3, N)`` lie below the horizon."""
        return below_horizon(self.position, point)


def _turned_east(vector: Array, angle: Array) -> Array:
    """``(3, N)`` turned about the Earth's axis."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return rows(cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1], vector[2])


def _earth_turn(vector: Array) -> Array:
    """``ω × w`` for the rotation of the Earth, ``(3, N)``."""
    return EARTH_RATE * rows(-vector[1], vector[0], zeros(vector, vector.shape[1:]))
