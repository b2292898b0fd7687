"""Four emitters that change their velocity, heard by bearing and Doppler: the cases of paper 000.

Two accelerate (1a, 1b), two turn (2a, 2b), each in a way the tracker knows. A fixed station follows 1a and 2a, but is
blind to the range of 1b, which runs along the line of sight, and nearly blind to that of 2b, which circles the station.
Flown by the policy ``stationary`` they are the paper's simulations; an observer that moves sees all four. They are
single fixed cases, meant for judging.
"""

from __future__ import annotations

import math

from passloc_env.belief import BeliefFeatures
from passloc_env.motion import ConstantVelocity, CoordinatedTurn, LinearMotion
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Bound, Episode, Scenario
from passloc_env.sensors import Bearing, Doppler
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import ScatteredPrior, UnscentedKalman
from passloc_env.units import DEGREE, GIGAHERTZ, KILOMETRE


def _case(
    name: str, position: tuple[float, float], velocity: tuple[float, float], motion: LinearMotion, keep_out: float
) -> Scenario:
    start = CartesianStart(position=position, velocity=velocity)
    away = math.hypot(*position)
    return Scenario(
        name=name,
        target=Target(start=start, motion=motion),
        platforms=(TurnLimitedPlatform(speed=225.0, max_turn_rate=3 * DEGREE),),
        sensors=(Bearing(sigma=3e-3), Doppler(sigma=10.0, carrier=GIGAHERTZ)),
        prior=ScatteredPrior(range_sigma=0.2 * away, velocity_sigma=50.0),
        tracker=UnscentedKalman(motion=motion),
        bound=Bound(motion=motion),
        observation=BeliefFeatures(range_scale=away),
        episode=Episode(steps=300, min_range=keep_out),
    )


BEARING_DOPPLER_1A = _case(
    "BearingDopplerCase1a",
    position=(120 * KILOMETRE, 60 * KILOMETRE),
    velocity=(100.0, -175.0),
    motion=ConstantVelocity(known_acceleration=(2.5, 0.0)),
    keep_out=10 * KILOMETRE,
)
"""Accelerates across the line of sight: observable from a fixed station."""

BEARING_DOPPLER_1B = _case(
    "BearingDopplerCase1b",
    position=(120 * KILOMETRE, 60 * KILOMETRE),
    velocity=(200.0, 100.0),
    motion=ConstantVelocity(known_acceleration=(-2.0, -1.0)),
    keep_out=10 * KILOMETRE,
)
"""Accelerates along the line of sight: a fixed station never learns the range."""

BEARING_DOPPLER_2A = _case(
    "BearingDopplerCase2a",
    position=(35 * KILOMETRE, 60 * KILOMETRE),
    velocity=(120.0, 160.0),
    motion=CoordinatedTurn(turn_rate=-3 * DEGREE),
    keep_out=10 * KILOMETRE,
)
"""Turns on the spot: observable from a fixed station."""

BEARING_DOPPLER_2B = _case(
    "BearingDopplerCase2b",
    position=(23 * KILOMETRE, 0.0),
    velocity=(0.0, 200.0),
    motion=CoordinatedTurn(turn_rate=-0.5 * DEGREE),
    keep_out=5 * KILOMETRE,
)
"""All but circles the station, 22.9 km against 23 km: observable from there in principle, hardly in practice."""
