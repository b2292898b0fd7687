"""The world of the hand-written peer: what chance draws, the emitter, the own ship. One of each, in plain floats."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passloc_env import Scenario, ScenarioError
from passloc_env.arrays import Array, Number
from passloc_env.distributions import Distribution
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Manoeuvre
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.rewards import DEFAULT_REWARD
from passloc_env.sensors import Bearing, Doppler
from passloc_env.target import PolarStart
from passloc_env.tracking import RangePrior, UnscentedKalman


@dataclass(frozen=True)
class Manoeuvring:
    """When and how the emitter leaves its straight course; the default is not at all.

    Attributes:
        kind: 0 none, 1 acceleration along the track, 2 turn.
        start: s.
        duration: s.
        acceleration: m/s².
        turn_rate: rad/s, positive to starboard.
    """

    kind: int = 0
    start: float = 0.0
    duration: float = 0.0
    acceleration: float = 0.0
    turn_rate: float = 0.0


@dataclass(frozen=True)
class Draw:
    """All that chance decides about one episode; SI and radians, angles clockwise from north.

    Attributes:
        range: initial range of the emitter from the origin.
        bearing: its initial bearing from there.
        speed: its initial speed.
        course: its initial course.
        own_heading: initial heading of the own ship.
        own_speed: its constant speed.
        manoeuvring: what the emitter does on its way.
        noise: standard normals ``(steps + 1, m)``, row 0 for the first look.
    """

    range: float
    bearing: float
    speed: float
    course: float
    own_heading: float
    own_speed: float
    manoeuvring: Manoeuvring
    noise: Array


def draw(scenario: Scenario, random: np.random.Generator) -> Draw:
    """A new episode of a scenario that :func:`check` has accepted."""

    def value(quantity: Number) -> float:
        if isinstance(quantity, Distribution):
            return float(quantity.sample(random.random(1))[0])
        return float(quantity)

    start, motion, own = scenario.target.start, scenario.target.motion, scenario.platforms[0]
    assert isinstance(start, PolarStart)
    assert isinstance(own, TurnLimitedPlatform)
    manoeuvring = Manoeuvring()
    if isinstance(motion, Manoeuvre):
        manoeuvring = Manoeuvring(
            int(value(motion.kind)),
            value(motion.start),
            value(motion.duration),
            value(motion.acceleration),
            value(motion.turn_rate),
        )
    return Draw(
        value(start.range),
        value(start.bearing),
        value(start.speed),
        value(start.course),
        value(own.heading),
        value(own.speed),
        manoeuvring,
        random.standard_normal((scenario.episode.steps + 1, len(scenario.sensors))),
    )


class Emitter:
    """Position, speed and course of the emitter."""

    def __init__(self, chance: Draw) -> None:
        self.east = chance.range * math.sin(chance.bearing)
        self.north = chance.range * math.cos(chance.bearing)
        self.speed, self.course = chance.speed, chance.course
        self._manoeuvring = chance.manoeuvring

    def move(self, time: float, period: float) -> None:
        """Advance from ``time`` by one period (s), with the manoeuvre at its mean over the step."""
        plan = self._manoeuvring
        gain = turn = 0.0
        if plan.kind:
            begin, end = max(time, plan.start), min(time + period, plan.start + plan.duration)
            overlap = max(0.0, end - begin)
            if plan.kind == 1:
                gain = plan.acceleration * overlap
            else:
                turn = plan.turn_rate * overlap
        distance = (self.speed + 0.5 * gain) * period * sinc(0.5 * turn)
        middle = self.course + 0.5 * turn
        self.east += distance * math.sin(middle)
        self.north += distance * math.cos(middle)
        self.speed += gain
        self.course += turn

    @property
    def velocity(self) -> tuple[float, float]:
        """East and north, m/s."""
        return self.speed * math.sin(self.course), self.speed * math.cos(self.course)


class OwnShip:
    """A ship or aircraft at constant speed that turns towards a heading set-point no faster than it can."""

    def __init__(self, chance: Draw, max_turn_rate: float) -> None:
        self.east = self.north = 0.0
        self.heading, self.speed = chance.own_heading, chance.own_speed
        self.set_point = self.heading
        self._max_turn_rate = max_turn_rate

    def move(self, period: float) -> None:
        """An arc towards the set-point, then the rest of the period (s) straight."""
        turn = wrap(self.set_point - self.heading)
        arc = abs(turn) / self._max_turn_rate
        if arc > period:
            arc, turn = period, math.copysign(self._max_turn_rate * period, turn)
        chord = self.speed * arc * sinc(0.5 * turn)
        middle, final = self.heading + 0.5 * turn, self.heading + turn
        straight = self.speed * (period - arc)
        self.east += chord * math.sin(middle) + straight * math.sin(final)
        self.north += chord * math.cos(middle) + straight * math.cos(final)
        self.heading = wrap(final)

    @property
    def velocity(self) -> tuple[float, float]:
        """East and north, m/s."""
        return self.speed * math.sin(self.heading), self.speed * math.cos(self.heading)


def wrap(angle: float) -> float:
    """The same angle in ``[-π, π]``."""
    return math.remainder(angle, math.tau)


def sinc(x: float) -> float:
    """``sin(x)/x``."""
    return math.sin(x) / x if x else 1.0


def check(scenario: Scenario) -> None:
    """Raise ScenarioError unless the scenario is one the peer was written for.

    That is: a planar emitter, one turn-limited own ship with heading commands, a bearing and perhaps the Doppler of a
    known carrier, an unscented filter, with accelerations or without, from a range prior, and the four default reward
    terms.
    """
    parts = {
        "target.start": (scenario.target.start, PolarStart),
        "platforms.0": (scenario.platforms[0], TurnLimitedPlatform),
        "prior": (scenario.prior, RangePrior),
        "tracker": (scenario.tracker, UnscentedKalman),
        "tracker.motion": (scenario.tracker.motion, (ConstantVelocity, ConstantAcceleration)),
        "bound.motion": (scenario.bound.motion, ConstantVelocity),
    }
    for field, (found, wanted) in parts.items():
        allowed = wanted if isinstance(wanted, tuple) else (wanted,)
        if type(found) not in allowed:
            known = " and ".join(kind.__name__ for kind in allowed)
            raise ScenarioError(field, type(found).__name__, f"the peer knows only {known}")
    _check_emitter(scenario)
    own = scenario.platforms[0]
    assert isinstance(own, TurnLimitedPlatform)
    if len(scenario.platforms) != 1 or own.control != "heading" or any(own.position):
        raise ScenarioError("platforms", len(scenario.platforms), "the peer flies one platform, from the origin")
    kinds = [type(sensor) for sensor in scenario.sensors]
    if kinds not in ([Bearing], [Bearing, Doppler]) or any(sensor.nuisances for sensor in scenario.sensors):
        raise ScenarioError("sensors", [kind.__name__ for kind in kinds], "the peer hears a bearing, perhaps a Doppler")
    names = [term.name for term in scenario.reward]
    if names != [term.name for term in DEFAULT_REWARD]:
        raise ScenarioError("reward", names, "the peer knows only the default terms")


def _check_emitter(scenario: Scenario) -> None:
    """An undisturbed straight course, or one that either turns or accelerates."""
    motion = scenario.target.motion
    if isinstance(motion, Manoeuvre):
        kind = motion.kind
        largest = kind.support[1] if isinstance(kind, Distribution) else kind
        if largest > 2.0:
            raise ScenarioError("target.motion.kind", kind, "the peer's emitter cannot turn and accelerate at once")
    elif motion != ConstantVelocity():
        raise ScenarioError("target.motion", type(motion).__name__, "the peer's emitter flies straight or manoeuvres")
