"""A vessel with two arrays a kilometre apart hears an accelerating emitter: paper 003 with a vessel that may turn.

Two bearings cross, unless the emitter lies on the line through both arrays: there they agree whatever the range.
Turning the vessel turns its baseline. The emitter starts from rest and accelerates; half of the vessels begin with
their baseline pointing straight at it, and four in nine of the emitters come straight in.
"""

from __future__ import annotations

from passloc_env.belief import BeliefFeatures
from passloc_env.distributions import Choice, Uniform
from passloc_env.motion import ConstantAcceleration
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Bound, Episode, Scenario
from passloc_env.sensors import Bearing, Doppler
from passloc_env.target import PolarStart, Target
from passloc_env.tracking import ScatteredPrior, UnscentedKalman
from passloc_env.units import DEGREE, KILOMETRE

_WANDERING = ConstantAcceleration(acceleration_noise=0.01)
_BASELINE = (1 * KILOMETRE, 0.0)
_FROM_THE_WEST = -90 * DEGREE

# An emitter in the west that goes east comes straight in; a vessel that heads east points its baseline at it.
_COURSES = (90.0, 90.0, 90.0, 90.0, 0.0, 45.0, 135.0, 180.0, -90.0)
_HEADINGS = (90.0, 90.0, 90.0, 30.0, 150.0, -150.0)

DUAL_ARRAY = Scenario(
    name="DualArray",
    target=Target(
        start=PolarStart(
            range=Uniform(low=4 * KILOMETRE, high=7 * KILOMETRE),
            bearing=_FROM_THE_WEST,
            course=Choice(values=tuple(angle * DEGREE for angle in _COURSES)),
            acceleration=Uniform(low=0.01, high=0.04),
        ),
        motion=ConstantAcceleration(),
    ),
    platforms=(
        TurnLimitedPlatform(
            heading=Choice(values=tuple(angle * DEGREE for angle in _HEADINGS)),
            speed=5.0,
            max_turn_rate=0.5 * DEGREE,
        ),
    ),
    sensors=(
        Bearing(sigma=0.2 * DEGREE),
        Bearing(sigma=0.3 * DEGREE, lever_arm=_BASELINE),
        Doppler(sigma=0.5, carrier=500.0, propagation_speed=1500.0),
    ),
    prior=ScatteredPrior(range_sigma=1 * KILOMETRE, velocity_sigma=1.0, acceleration_sigma=0.02),
    tracker=UnscentedKalman(motion=_WANDERING),
    bound=Bound(motion=_WANDERING),
    observation=BeliefFeatures(range_scale=5 * KILOMETRE, speed_scale=5.0, acceleration_scale=0.05),
    episode=Episode(steps=200, period=2.0, decision_every=10, min_range=500.0),
)
"""4–7 km, 0.01–0.04 m/s² from rest; bearings 0.2° and 0.3°, frequency 0.5 Hz of 500 Hz each 2 s, 400 s."""
