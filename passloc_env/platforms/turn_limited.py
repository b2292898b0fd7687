"""Aircraft and vessels that keep their speed and choose their heading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.angles import sine_cosine, turned, wrap
from passloc_env.arrays import Array, Number, blank, numbers
from passloc_env.errors import ScenarioError
from passloc_env.fields import option, quantity, vector
from passloc_env.motion import sinc
from passloc_env.platforms.platform import Platform, stack
from passloc_env.platforms.pose import PlanarPose, Pose


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
        heading = numbers(self.heading)
        return stack((*self.position, heading, 0.0, np.sin(heading), np.cos(heading)), environments)

    def state_at(self, pose: Pose) -> Array:
        """Position, heading and turn rate ``(6, N)`` of a planar pose."""
        assert isinstance(pose, PlanarPose)
        heading = pose.heading
        return stack((*pose.position, heading, pose.turn_rate, np.sin(heading), np.cos(heading)), len(heading))

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
            sine, cosine = sine_cosine(0.5 * turn)
            chord = period * sinc(0.5 * turn)
        else:
            limit = self.max_turn_rate * period
            turn = np.minimum(np.maximum(wrap(set_point[0] - state[2]), -limit), limit)
            size = np.abs(turn)
            rate = np.where(size < limit, 0.0, turn / period)
            straight = period - size / self.max_turn_rate
            sine, cosine = sine_cosine(0.5 * turn)
            chord = (2.0 / self.max_turn_rate) * np.abs(sine)
        middle = turned(state[4:], sine, cosine)
        forward = turned(middle, sine, cosine)
        moved = blank(state, state.shape)
        moved[:2] = state[:2] + self.speed * (chord * middle + straight * forward)
        moved[2] = state[2] + turn
        moved[3] = rate
        moved[4:] = forward
        return moved

    def pose(self, state: Array) -> PlanarPose:
        """Pose with heading; the acceleration is that of the turn at this instant."""
        return PlanarPose(state[:2], self.speed * state[4:], state[2], state[3])
