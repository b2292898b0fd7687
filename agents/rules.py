"""Classical rules: fixed recipes for the heading, from the believed line of sight and the clock.

Every rule wants a heading for each turn-limited platform; the platform turns that wish into its own action, whatever
its control style. Other platforms with controls are left neutral, except by :class:`BodyRate`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from agents.parameters import Number
from passloc_env.angles import bearing_of, wrap
from passloc_env.arrays import Array
from passloc_env.belief import Belief
from passloc_env.platforms import PlanarPose, Platform, TurnLimitedPlatform
from passloc_env.scenario import Scenario
from passloc_env.sightline import distance
from passloc_env.units import DEGREE, MINUTE

_TURN_ON_THE_SPOT = 30 * DEGREE
"""Turn per decision of a circle flown by a platform whose turn rate is unlimited."""

_OPENING = 120.0
"""Degrees from the line of sight: opens the range and still crosses it."""

_LARGEST_TURN = 170 * DEGREE
"""A heading further to starboard would be reached by turning to port."""


@dataclass
class Helm:
    """What a rule knows at the helm of one platform; angles in radians, arrays ``(N,)``."""

    platform: TurnLimitedPlatform
    heading: Array
    line_of_sight: Array
    """Believed bearing of the emitter."""
    range: Array
    """Believed range, m."""
    time: Array
    interval: float


@dataclass(frozen=True)
class Rule:
    """Base of rules that choose a heading."""

    name: str = "rule"
    overrides: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def heading(self, helm: Helm) -> Array:
        """The wanted heading ``(N,)``."""
        raise AssertionError(f"{type(self).__name__} must define heading")

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """The actions ``(N, a)`` that turn every turn-limited platform towards the wanted heading."""
        parts = []
        emitter = belief.mean[belief.layout.position]
        for platform, pose in zip(belief.platforms, belief.poses, strict=True):
            if isinstance(platform, TurnLimitedPlatform) and isinstance(pose, PlanarPose):
                offset = emitter - pose.position
                bearing, away = bearing_of(offset), distance(offset)
                helm = Helm(platform, pose.heading, bearing, away, belief.time, belief.interval)
                wanted = self.heading(helm)
                parts.append(platform.action_towards(wanted, helm.heading, helm.line_of_sight, helm.interval)[None])
            else:
                parts.append(self.neutral(platform, len(belief.time)))
        return np.clip(np.concatenate(parts).T, -1.0, 1.0)

    def neutral(self, platform: Platform, environments: int) -> Array:
        """What platforms do that choose no heading ``(controls, N)``: nothing."""
        return np.zeros((platform.controls, environments))


@dataclass(frozen=True)
class Straight(Rule):
    """Keep the heading."""

    name: str = "straight"

    def heading(self, helm: Helm) -> Array:
        """The present heading."""
        return helm.heading


@dataclass(frozen=True)
class Stationary(Straight):
    """Stay where you are: the fixed station. Flown with the platforms' speed set to zero."""

    name: str = "stationary"


@dataclass(frozen=True)
class Random(Rule):
    """A uniformly random action at each decision."""

    name: str = "random"

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """Uniform in [-1, 1]."""
        size = sum(platform.controls for platform in belief.platforms)
        return rng.uniform(-1.0, 1.0, (len(belief.time), size))


@dataclass(frozen=True)
class Circle(Rule):
    """Turn to starboard all the time, at the maximum rate; 30° per decision where that is unlimited."""

    name: str = "circle"

    def heading(self, helm: Helm) -> Array:
        """As far to starboard as one interval allows."""
        unlimited = np.isinf(helm.platform.max_turn_rate)
        turn = np.where(unlimited, _TURN_ON_THE_SPOT, helm.platform.max_turn_rate * helm.interval)
        return wrap(helm.heading + np.minimum(turn, _LARGEST_TURN))


@dataclass(frozen=True)
class Zigzag(Rule):
    """Legs alternately to starboard and to port of the believed line of sight.

    Args:
        angle: between leg and line of sight, degrees; negative to begin to port.
        leg: seconds per leg.
        first: seconds of the first leg, if it is another; 0 if not.
        keep: believed range below which every leg leads away from the emitter, m.
    """

    name: str = "zigzag"
    angle: float = 60.0
    leg: float = 40.0
    first: float = 0.0
    keep: float = 0.0

    def heading(self, helm: Helm) -> Array:
        """The line of sight ± the angle, by the clock."""
        legs = np.floor((helm.time - (self.first or self.leg)) / self.leg) + 1.0
        side = np.where(np.maximum(legs, 0.0) % 2 == 0, 1.0, -1.0)
        opening = math.copysign(max(abs(self.angle), _OPENING), self.angle)
        angle = np.where(helm.range < self.keep, opening, self.angle)
        return wrap(helm.line_of_sight + side * angle * DEGREE)


@dataclass(frozen=True)
class Perpendicular(Rule):
    """Across the believed line of sight, to the side that is nearer to the present heading."""

    name: str = "perpendicular"

    def heading(self, helm: Helm) -> Array:
        """The line of sight ± 90°."""
        side = np.where(np.sin(helm.heading - helm.line_of_sight) >= 0.0, 1.0, -1.0)
        return wrap(helm.line_of_sight + side * 90 * DEGREE)


@dataclass(frozen=True)
class FlyAt(Rule):
    """Straight at the believed emitter."""

    name: str = "fly-at"

    def heading(self, helm: Helm) -> Array:
        """The line of sight."""
        return helm.line_of_sight


@dataclass(frozen=True)
class Legs(Rule):
    """Fixed headings by the clock, as published for a case.

    Args:
        legs: pairs (time in seconds from which it holds, heading in degrees), in order.
    """

    name: str = "legs"
    legs: tuple[tuple[float, float], ...] = ()

    def heading(self, helm: Helm) -> Array:
        """The heading of the leg in force."""
        starts = np.array([start for start, _ in self.legs])
        headings = np.array([heading for _, heading in self.legs]) * DEGREE
        leg = np.searchsorted(starts, helm.time + 1e-9, side="right") - 1
        return wrap(headings[np.maximum(leg, 0)])


@dataclass(frozen=True)
class BodyRate(Rule):
    """Turn every body that can be turned at a steady rate; platforms that choose a heading keep it.

    Args:
        rates: shares of the largest rate about each body axis: roll, pitch, yaw.
    """

    name: str = "yaw"
    rates: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def heading(self, helm: Helm) -> Array:
        """The present heading."""
        return helm.heading

    def neutral(self, platform: Platform, environments: int) -> Array:
        """The rates, for a body that can be turned."""
        if not platform.steers_body:
            return super().neutral(platform, environments)
        return np.repeat(np.array(self.rates)[:, None], environments, axis=1)


PUBLISHED_LEGS: dict[str, tuple[tuple[float, float], ...]] = {
    "OwnShipModerate": (
        (0.0, 140.0),
        *((minute * MINUTE, heading) for minute, heading in ((13, 110.0), (14, 80.0), (15, 50.0), (16, 20.0))),
    ),
    "OwnShipSevere": ((0.0, -80.0), (15 * MINUTE, 146.0)),
}
"""The own-ship legs of the literature, by scenario. A heading chosen after measurement k acts from k to k + 1."""

_TUNED = ("zigzag:angle=70:leg=480:keep=1800", "zigzag:angle=115:leg=360:first=1080:keep=2200")

TUNED_ZIGZAGS: dict[str, tuple[str, ...]] = {"OwnShipModerate": _TUNED, "OwnShipSevere": _TUNED}
"""The best of a grid for the moderate own-ship case, and for the severe one; each loses the other case.

Best by the RMS error at the end of those that violate in less than 1 % of 1000 episodes from seed 5 000 000 on, which
judge nothing. Moderate: 60° to 80° in steps of 5°, to either side, legs of 7 to 12 minutes, keeping 1.7 to 2 km.
Severe: 75° to 115° in steps of 10°, to either side, legs of 3 to 10 minutes, the first of 14 to 22, keeping 2.2 km.
"""


def stationary(scenario: Scenario) -> Stationary:
    """Stay: the fixed station, its platforms' speed set to zero."""
    moving = [i for i, platform in enumerate(scenario.platforms) if isinstance(platform, TurnLimitedPlatform)]
    return Stationary(overrides={f"platforms.{index}.speed": 0.0 for index in moving})


def zigzag(
    scenario: Scenario,
    angle: Annotated[
        float, Number("between leg and line of sight; negative to begin to port", "degrees", -180.0, 180.0)
    ] = Zigzag.angle,
    leg: Annotated[
        float | None,
        Number("length of a leg", "s", above=True, by_default="a sixth of the episode, in whole decisions"),
    ] = None,
    first: Annotated[float, Number("length of the first leg, if it is another; 0 if not", "s")] = Zigzag.first,
    keep: Annotated[
        float, Number("believed range below which every leg leads away from the emitter", "m")
    ] = Zigzag.keep,
) -> Zigzag:
    """Zigzag: legs to starboard and to port of the believed line of sight, in turn."""
    episode = scenario.episode
    decisions = max(1, round(episode.duration / 6.0 / episode.interval))
    seconds = decisions * episode.interval if leg is None else leg
    words = [
        f"zigzag {angle:g}° {seconds:g} s",
        f"first {first:g} s" * (first > 0),
        f"keep {keep / 1e3:g} km" * (keep > 0),
    ]
    return Zigzag(", ".join(filter(None, words)), angle=angle, leg=seconds, first=first, keep=keep)


def published_legs(scenario: Scenario) -> Legs:
    """Steer the legs that the literature has for the case."""
    return Legs(legs=PUBLISHED_LEGS[scenario.name])


def yaw(scenario: Scenario) -> BodyRate:
    """Yaw every body that can be turned, at its largest rate; headings are kept."""
    return BodyRate()


def roll(scenario: Scenario) -> BodyRate:
    """Roll every body that can be turned, at its largest rate; headings are kept."""
    return BodyRate(name="roll", rates=(1.0, 0.0, 0.0))
