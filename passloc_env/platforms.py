"""Observers: where they are, how they answer a command, and what they believe about themselves.

A platform keeps its state in one array ``(rows, N)`` and answers three questions: what a command means
(:meth:`Platform.set_point`), where it goes in a step (:meth:`Platform.move`), and what its pose is, twice: the *true*
one, from which the world measures, and the *reported* one, which tracker and agent get. Navigation and attitude errors
live in the difference; platforms without them report the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from passloc_env.angles import direction, turned, wrap
from passloc_env.arrays import Array, Number, rows
from passloc_env.component import Component
from passloc_env.errors import ScenarioError
from passloc_env.fields import abstract, option, quantity, vector
from passloc_env.lazy import lazy
from passloc_env.motion import sinc


class Pose:
    """Position, velocity, acceleration and attitude of a platform, each ``(d, N)``; SI.

    ``attitude (d, d, N)`` holds the body axes as rows (forward first), ``attitude_rate`` its time derivative.
    """

    def __init__(
        self,
        position: Array,
        velocity: Array,
        acceleration: Array | None = None,
        attitude: Array | None = None,
        attitude_rate: Array | None = None,
    ) -> None:
        self.position, self.velocity = position, velocity
        given = {"acceleration": acceleration, "attitude": attitude, "attitude_rate": attitude_rate}
        self.__dict__.update({name: value for name, value in given.items() if value is not None})

    @classmethod
    def join(cls, poses: list[Any]) -> Pose:
        """The poses of several batches put end to end."""
        names = ("position", "velocity", "acceleration", "attitude", "attitude_rate")
        return cls(*(np.concatenate([getattr(pose, name) for pose in poses], axis=-1) for name in names))

    @lazy
    def acceleration(self) -> Array:
        """``(d, N)``, m/s²; zero unless the platform says otherwise."""
        return np.zeros(self.position.shape)

    @lazy
    def attitude(self) -> Array:
        """Body axes as rows ``(d, d, N)``; the axes of the frame unless the platform says otherwise."""
        d, n = self.position.shape
        return np.broadcast_to(np.eye(d)[..., None], (d, d, n))

    @lazy
    def attitude_rate(self) -> Array:
        """Time derivative of :attr:`attitude`, rad/s."""
        return np.zeros((len(self.position), *self.position.shape))

    def mounted(self, lever_arm: tuple[Number, ...]) -> Pose:
        """The pose of a point of the body, ``lever_arm`` given along the body axes, m.

        The point takes part in the body's rotation; its centripetal acceleration is that of a steady rotation.
        """
        if not lever_arm:
            return self
        arms = [np.asarray(arm, float) for arm in lever_arm]
        attitude, rate = self.attitude, self.attitude_rate
        position, velocity, acceleration = self.position + 0.0, self.velocity + 0.0, self.acceleration + 0.0
        for axis, arm in enumerate(arms):
            position += arm * attitude[axis]
            velocity += arm * rate[axis]
            for other in range(len(attitude)):
                projection = sum(rate[axis, k] * attitude[other, k] for k in range(len(attitude)))
                acceleration += arm * projection * rate[other]
        return Pose(position, velocity, acceleration, attitude, rate)


class PlanarPose(Pose):
    """A pose in the plane whose body points along its heading."""

    def __init__(self, position: Array, velocity: Array, heading: Array, turn_rate: Array) -> None:
        super().__init__(position, velocity)
        self.heading, self.turn_rate = heading, turn_rate

    @classmethod
    def join(cls, poses: list[Any]) -> PlanarPose:
        """The poses of several batches put end to end."""
        names = ("position", "velocity", "heading", "turn_rate")
        return cls(*(np.concatenate([getattr(pose, name) for pose in poses], axis=-1) for name in names))

    @lazy
    def acceleration(self) -> Array:
        """That of the turn: rate times speed, to starboard ``(2, N)``."""
        return self.turn_rate * rows(self.velocity[1], -self.velocity[0])

    @lazy
    def attitude(self) -> Array:
        """Forward and starboard axes as rows ``(2, 2, N)``."""
        forward = direction(self.heading)
        return rows(forward, rows(forward[1], -forward[0]))

    @lazy
    def attitude_rate(self) -> Array:
        """Time derivative of the axes: forward turns towards starboard, starboard towards aft."""
        forward, starboard = self.attitude
        return rows(self.turn_rate * starboard, -self.turn_rate * forward)


@abstract
class Platform(Component):
    """Base of observers."""

    controls: int = 0
    """Number of action components the platform takes, each in [-1, 1]."""

    set_points: int = 0
    """Rows of the set-point that a command becomes."""

    dimension: int = 2
    """Number of spatial axes it lives in."""

    def start(self, environments: int) -> Array:
        """The state ``(rows, N)`` at the beginning of an episode."""
        raise AssertionError(f"{type(self).__name__} must define start")

    def set_point(self, state: Array, action: Array, line_of_sight: Array) -> Array:
        """What to hold until the next decision, ``(set_points, N)``.

        Args:
            state: the platform's state ``(rows, N)``.
            action: its part of the action ``(controls, N)``, already within [-1, 1].
            line_of_sight: believed unit vector to the emitter ``(d, N)``.
        """
        return np.zeros((self.set_points, state.shape[-1]))

    def move(self, state: Array, set_point: Array, period: float) -> Array:
        """The state one period (s) later; a new array."""
        return state

    def pose(self, state: Array) -> Pose:
        """The true pose."""
        raise AssertionError(f"{type(self).__name__} must define pose")

    def reported_pose(self, state: Array, pose: Pose) -> Pose:
        """The pose that tracker and agent get, given the true one."""
        return pose


def stack(values: tuple[Number, ...], environments: int) -> Array:
    """Quantities as rows ``(k, N)``."""
    return np.stack([np.broadcast_to(np.asarray(v, float), (environments,)) for v in values])


@dataclass(frozen=True, kw_only=True)
class FixedStation(Platform):
    """A station that stays where it is and takes no action; any number of dimensions."""

    position: tuple[Number, ...] = vector("position by axis", (0.0, 0.0), unit="m")

    @property
    def dimension(self) -> int:  # type: ignore[override]
        """As many axes as the position has."""
        return len(self.position)

    def start(self, environments: int) -> Array:
        """The position ``(d, N)``."""
        return stack(self.position, environments)

    def pose(self, state: Array) -> Pose:
        """At rest."""
        still = np.zeros(state.shape)
        return Pose(state, still, still)


@dataclass(frozen=True, kw_only=True)
class TurnLimitedPlatform(Platform):
    """An aircraft or vessel at constant speed that can only turn; one action in [-1, 1].

    ``control="heading"``: the action, times π, is a heading set-point relative to the *believed* line of sight at the
    decision (0: fly at the emitter, ±0.5: across, to starboard or port of it). An autopilot turns towards it at the
    maximum rate, then flies straight; an infinite rate turns on the spot.
    ``control="turn_rate"``: the action, times the maximum rate, is the turn rate (positive to starboard).
    """

    controls = 1
    set_points = 1

    position: tuple[Number, ...] = vector("starting position: east, north", (0.0, 0.0), unit="m")
    heading: Number = quantity("starting heading, clockwise from north", 0.0, unit="rad")
    speed: Number = quantity("speed", unit="m/s", at_least=0)
    max_turn_rate: Number = quantity("largest turn rate", unit="rad/s", above=0, infinite=True)
    control: str = option("what the action sets", "heading", ("heading", "turn_rate"))

    def validate(self) -> None:
        """The plane has two axes, and a rate command needs a finite rate."""
        if len(self.position) != 2:
            raise ScenarioError("position", self.position, "must have 2 axes: east, north")
        if self.control == "turn_rate" and isinstance(self.max_turn_rate, float) and np.isinf(self.max_turn_rate):
            raise ScenarioError("max_turn_rate", self.max_turn_rate, "must be finite with control 'turn_rate'")

    def start(self, environments: int) -> Array:
        """East, north, heading, turn rate, and the forward axis ``(6, N)``."""
        heading = np.asarray(self.heading, float)
        return stack((*self.position, heading, 0.0, np.sin(heading), np.cos(heading)), environments)

    def set_point(self, state: Array, action: Array, line_of_sight: Array) -> Array:
        """A heading, or a turn rate, ``(1, N)``."""
        if self.control == "turn_rate":
            return action * self.max_turn_rate
        return wrap(np.arctan2(line_of_sight[0], line_of_sight[1]) + np.pi * action)

    def action_towards(self, heading: Array, own_heading: Array, line_of_sight: Array, interval: float) -> Array:
        """The action ``(N,)`` that brings a platform at ``own_heading`` to ``heading``, or as close as it can.

        Args:
            heading: wanted heading ``(N,)``, rad.
            own_heading: present heading ``(N,)``, rad.
            line_of_sight: believed bearing of the emitter ``(N,)``, rad.
            interval: time until the next decision, s.
        """
        if self.control == "heading":
            return wrap(heading - line_of_sight) / np.pi
        return np.clip(wrap(heading - own_heading) / (self.max_turn_rate * interval), -1.0, 1.0)

    def move(self, state: Array, set_point: Array, period: float) -> Array:
        """An arc at the turn rate, then the rest of the period straight.

        The chord of an arc of radius ``R`` that turns by ``φ`` is ``2 R sin(φ/2)`` long and points along the mid-arc
        heading; lengths are in units of the speed.
        """
        if self.control == "turn_rate":
            rate = set_point[0]
            turn, straight = rate * period, 0.0
            sine, cosine = np.sin(0.5 * turn), np.cos(0.5 * turn)
            chord = period * sinc(0.5 * turn)
        else:
            limit = self.max_turn_rate * period
            turn = np.minimum(np.maximum(wrap(set_point[0] - state[2]), -limit), limit)
            size = np.abs(turn)
            rate = np.where(size < limit, 0.0, turn / period)
            straight = period - size / self.max_turn_rate
            sine, cosine = np.sin(0.5 * turn), np.cos(0.5 * turn)
            chord = (2.0 / self.max_turn_rate) * np.abs(sine)
        middle = turned(state[4:], sine, cosine)
        forward = turned(middle, sine, cosine)
        moved = np.empty(state.shape)
        moved[:2] = state[:2] + self.speed * (chord * middle + straight * forward)
        moved[2] = state[2] + turn
        moved[3] = rate
        moved[4:] = forward
        return moved

    def pose(self, state: Array) -> PlanarPose:
        """Pose with heading; the acceleration is that of the turn at this instant."""
        return PlanarPose(state[:2], self.speed * state[4:], state[2], state[3])
