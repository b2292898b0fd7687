"""Three vehicles with very poor direction finders cross their bearings: paper 004 with vehicles that move.

In a city reflections turn a bearing by up to 45° either way. Three such bearings leave an error of a quarter of the
square's side, in the median; two minutes of them, one of a sixteenth from fixed stations, and half of that when the
vehicles drive where lines cross well. The errors are uniform, for which there is no Cramér–Rao bound: the bound
reported counts them as Gaussian of the same variance, and the score is the error itself.
"""

from __future__ import annotations

import math

from passloc_env.belief import BeliefFeatures
from passloc_env.distributions import Uniform
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.rewards import KeepOut, PositionError
from passloc_env.scenario import Episode, Scenario
from passloc_env.sensors import Bearing
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import PlacePrior, RecursiveCrossFix
from passloc_env.units import DEGREE, KILOMETRE

SIDE = 1 * KILOMETRE
"""Side of the square."""

_INSIDE = Uniform(low=0.1 * SIDE, high=0.9 * SIDE)
_ANYWHERE = Uniform(low=0.0, high=SIDE)


def _vehicle(east: Uniform | float, north: Uniform | float) -> TurnLimitedPlatform:
    """A vehicle that starts on an edge of the square and turns on the spot."""
    return TurnLimitedPlatform(
        position=(east, north), heading=Uniform(low=-math.pi, high=math.pi), speed=10.0, max_turn_rate=math.inf
    )


CROSS_FIX = Scenario(
    name="CrossFix",
    target=Target(start=CartesianStart(position=(_INSIDE, _INSIDE), velocity=(0.0, 0.0))),
    platforms=(_vehicle(_ANYWHERE, 0.0), _vehicle(0.0, _ANYWHERE), _vehicle(SIDE, _ANYWHERE)),
    sensors=tuple(
        Bearing(platform=vehicle, sigma=45 * DEGREE / math.sqrt(3.0), noise_law="uniform") for vehicle in range(3)
    ),
    prior=PlacePrior(position=(0.5 * SIDE, 0.5 * SIDE), position_sigma=0.3 * SIDE, velocity_sigma=1e-3),
    tracker=RecursiveCrossFix(),
    reward=(PositionError(scale=SIDE), KeepOut()),
    observation=BeliefFeatures(range_scale=SIDE, speed_scale=10.0),
    episode=Episode(steps=60, period=2.0, decision_every=5, min_range=50.0, lost_error=1000.0),
)
"""A square of 1 km, three vehicles at 10 m/s; bearings within ±45° each 2 s for 2 minutes; keep-out 50 m."""
