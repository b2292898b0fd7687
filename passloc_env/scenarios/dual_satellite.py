"""Two satellites hear an aircraft by interferometers and the time difference: paper 001 with bodies that may turn.

The paper takes attitude errors as fresh at every pulse. A real one stays: 0.05° of misalignment is 9.4° of phase and
most of a kilometre on the ground, in every look the same. Here it is an unknown constant of each body, estimated along
with the emitter. As long as the bodies point down, a misalignment and a displaced emitter look alike; turning the body
about the line to the Earth moves the one and not the other.
"""

from __future__ import annotations

import math

from passloc_env.belief import BeliefFeatures
from passloc_env.distributions import Uniform
from passloc_env.platforms import CircularOrbit
from passloc_env.scenario import Episode, Scenario
from passloc_env.sensors import PhaseDifference, TimeDifference
from passloc_env.target import GeodeticStart, Target
from passloc_env.tracking import ExtendedKalman, HeightPrior
from passloc_env.units import DEGREE, GIGAHERTZ, KILOMETRE, NANOSECOND

_ALTITUDE = 700 * KILOMETRE
_SPACING = 80 * KILOMETRE / (6378.137 * KILOMETRE + _ALTITUDE)
"""80 km along the track, rad."""

_PULSES = 100
"""Pulses of a beat of 1 s; the value at mid-beat of the line through them has 1/100 of a pulse's variance."""


def _satellite(argument_of_latitude: float) -> CircularOrbit:
    return CircularOrbit(
        altitude=_ALTITUDE,
        inclination=60 * DEGREE,
        argument_of_latitude=argument_of_latitude,
        max_body_rate=2 * DEGREE,
    )


def interferometer(platform: int, axis: int, sigma: float, misalignment_sigma: float = 0.0) -> PhaseDifference:
    """A 3 m interferometer at 3 GHz along a body axis of a satellite."""
    return PhaseDifference(
        platform=platform,
        axis=axis,
        sigma=sigma,
        baseline=3.0,
        carrier=3 * GIGAHERTZ,
        misalignment_sigma=misalignment_sigma,
    )


DUAL_SATELLITE = Scenario(
    name="DualSatellite",
    target=Target(
        start=GeodeticStart(
            latitude=Uniform(low=24 * DEGREE, high=31 * DEGREE),
            longitude=Uniform(low=15 * DEGREE, high=24 * DEGREE),
            height=10 * KILOMETRE,
            speed=300.0,
            course=Uniform(low=-math.pi, high=math.pi),
        )
    ),
    platforms=(_satellite(30 * DEGREE), _satellite(30 * DEGREE - _SPACING)),
    sensors=(
        *(interferometer(p, axis, 20 * DEGREE / math.sqrt(_PULSES), 0.05 * DEGREE) for p in (0, 1) for axis in (1, 0)),
        TimeDifference(sigma=50 * NANOSECOND / math.sqrt(_PULSES)),
    ),
    prior=HeightPrior(height=10 * KILOMETRE, height_sigma=5 * KILOMETRE, velocity_sigma=400.0),
    tracker=ExtendedKalman(),
    observation=BeliefFeatures(range_scale=800 * KILOMETRE, speed_scale=3e3, nuisance_scale=0.05 * DEGREE),
    episode=Episode(steps=100, decision_every=5, min_range=0.0, lost_error=0.1),
)
"""700 km orbits 80 km apart, emitter at 10 km and 300 m/s; each second 100 pulses of 20°, 50 ns; 0.05° misaligned."""
