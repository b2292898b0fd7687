"""An aircraft that hears bearings and radial accelerations: paper 002 with an observer that may move.

The range's second derivative, ``v_⊥²/r`` for an emitter on a straight track, betrays the range of everything that
crosses the line of sight. An emitter that comes straight in has none and its range is hidden from a fixed station; the
observer's own way across the line of sight brings it back. A seventh of the emitters do just that.
"""

from __future__ import annotations

import math

from passloc_env.belief import BeliefFeatures
from passloc_env.distributions import Choice, Uniform
from passloc_env.motion import ConstantVelocity
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Episode, Scenario
from passloc_env.sensors import Bearing, RadialAcceleration
from passloc_env.target import PolarStart, Target
from passloc_env.tracking import RangePrior, UnscentedKalman
from passloc_env.units import DEGREE, KILOMETRE

_APPROACHES = tuple(180 * DEGREE + angle * DEGREE for angle in (0.0, 30.0, -30.0, 45.0, -45.0, 60.0, -60.0))

RADIAL_ACCELERATION = Scenario(
    name="RadialAcceleration",
    target=Target(
        start=PolarStart(
            range=Uniform(low=150 * KILOMETRE, high=250 * KILOMETRE),
            speed=Uniform(low=200.0, high=350.0),
            course=Choice(values=_APPROACHES),
        )
    ),
    platforms=(
        TurnLimitedPlatform(
            heading=Uniform(low=-math.pi, high=math.pi),
            speed=Uniform(low=200.0, high=250.0),
            max_turn_rate=3 * DEGREE,
        ),
    ),
    sensors=(Bearing(sigma=1e-3), RadialAcceleration(sigma=0.1)),
    prior=RangePrior(range=200 * KILOMETRE, range_sigma=40 * KILOMETRE, velocity_sigma=200.0),
    tracker=UnscentedKalman(motion=ConstantVelocity(acceleration_noise=0.02)),
    observation=BeliefFeatures(range_scale=200 * KILOMETRE),
    episode=Episode(steps=300, min_range=10 * KILOMETRE),
)
"""150–250 km, 200–350 m/s, inbound within 60°; bearing 1 mrad, radial acceleration 0.1 m/s², 300 s."""
