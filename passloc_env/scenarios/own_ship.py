"""A slow vessel that hears another, one bearing a minute: the own-ship cases of the literature.

*Moderate* is the non-manoeuvring case of Ristic, Arulampalam & Gordon, *Beyond the Kalman Filter*, ch. 6: moderately
nonlinear. *Severe* is that of Leong, Arulampalam et al., IEEE Signal Processing Letters 21(5), 2014: a fast inbound
target at three times the own speed, a poor prior, few and coarse bearings. Both are single fixed cases, meant for
judging; the heading is free at each minute, and what is rewarded is above all what the literature scores: how well the
emitter could be known at the end. Their features are in units of the range to be kept, so that keeping it looks the
same in both.
"""

from __future__ import annotations

import math

from passloc_env.belief import BeliefFeatures
from passloc_env.motion import ConstantVelocity
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.rewards import FinalBound, KeepOut, RangeBound
from passloc_env.scenario import Bound, Episode, Scenario
from passloc_env.sensors import Bearing
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import CoursePrior, RangeBank
from passloc_env.units import DEGREE, KILOMETRE, KNOT, MINUTE

_NEARLY_STRAIGHT = ConstantVelocity(acceleration_density=9e-12 * KILOMETRE**2)
"""q = 9e-12 km²/s³."""

_NEAR, _CROSSING = 0.3, 13 * MINUTE
"""Features: the range to be kept is 0.3 of what counts as one, and one unit of speed crosses it in 13 minutes, so that
ranges and speeds of both cases are of the order of one."""


def _own_ship(
    name: str,
    position: tuple[float, float],
    speed: float,
    course: float,
    own_heading: float,
    bearing_sigma: float,
    range_sigma: float,
    min_range: float,
    steps: int,
) -> Scenario:
    velocity = (speed * math.sin(course), speed * math.cos(course))
    return Scenario(
        name=name,
        target=Target(start=CartesianStart(position=position, velocity=velocity), motion=_NEARLY_STRAIGHT),
        platforms=(TurnLimitedPlatform(heading=own_heading, speed=5 * KNOT, max_turn_rate=math.inf),),
        sensors=(Bearing(sigma=bearing_sigma),),
        prior=CoursePrior(
            range_sigma=range_sigma,
            speed_sigma=2 * KNOT,
            course_sigma=math.pi / math.sqrt(12.0),
            min_range=0.6 * KILOMETRE,
            min_speed=0.6 * KNOT,
        ),
        tracker=RangeBank(motion=_NEARLY_STRAIGHT),
        bound=Bound(motion=_NEARLY_STRAIGHT),
        reward=(RangeBound(weight=0.1), FinalBound(weight=30.0, scale=10 * KILOMETRE), KeepOut()),
        observation=BeliefFeatures(range_scale=min_range / _NEAR, speed_scale=min_range / _CROSSING),
        episode=Episode(steps=steps, period=MINUTE, decision_every=1, min_range=min_range),
    )


OWN_SHIP_MODERATE = _own_ship(
    "OwnShipModerate",
    position=(4.92 * KILOMETRE, 0.85 * KILOMETRE),
    speed=4 * KNOT,
    course=-140 * DEGREE,
    own_heading=140 * DEGREE,
    bearing_sigma=1.5 * DEGREE,
    range_sigma=2 * KILOMETRE,
    min_range=1.5 * KILOMETRE,
    steps=32,
)
"""4 kn at 5 km, 1.5°, 32 minutes; keep-out 1.5 km."""

OWN_SHIP_SEVERE = _own_ship(
    "OwnShipSevere",
    position=(7.0909 * KILOMETRE, 7.0526 * KILOMETRE),
    speed=15 * KNOT,
    course=-135.4 * DEGREE,
    own_heading=-80 * DEGREE,
    bearing_sigma=2 * DEGREE,
    range_sigma=4 * KILOMETRE,
    min_range=2 * KILOMETRE,
    steps=30,
)
"""15 kn inbound at 10 km, 2°, 30 minutes; keep-out 2 km."""
