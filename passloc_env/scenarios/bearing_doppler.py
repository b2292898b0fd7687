"""Bearings and Doppler against an emitter that may manoeuvre, carrier known or unknown.

A third of the emitters fly straight, a third change speed, a third turn, at a time and for a while that nobody knows;
the tracker meets them all with one nearly-constant-velocity model. With the carrier unknown its offset becomes a state:
Doppler then tells nothing by its value, only by its change.
"""

from __future__ import annotations

from passloc_env.distributions import Choice, Uniform
from passloc_env.motion import ConstantVelocity, Manoeuvre
from passloc_env.scenario import Bound, Scenario
from passloc_env.sensors import Bearing, Doppler
from passloc_env.tracking import UnscentedKalman
from passloc_env.units import DEGREE, GIGAHERTZ

_MANOEUVRE = Manoeuvre(
    start=Uniform(low=0.0, high=144.0),
    duration=Uniform(low=40.0, high=100.0),
    acceleration=Choice(values=(-1.0, 1.0)),
    turn_rate=Uniform(low=0.3 * DEGREE, high=2.0 * DEGREE, either_sign=True),
    kind=Choice(values=(0.0, 1.0, 2.0)),
)

_AGILE = ConstantVelocity(acceleration_noise=3.0)

BEARING_DOPPLER = Scenario(
    name="BearingDoppler",
    sensors=(Bearing(sigma=3e-3), Doppler(sigma=10.0, carrier=3 * GIGAHERTZ)),
    tracker=UnscentedKalman(motion=_AGILE),
    bound=Bound(motion=_AGILE),
).override({"target.motion": _MANOEUVRE})
"""As BearingsOnly, with 10 Hz Doppler at 3 GHz."""

BEARING_DOPPLER_UNKNOWN_CARRIER = BEARING_DOPPLER.override(
    {
        "name": "BearingDopplerUnknownCarrier",
        "sensors.Doppler.carrier_sigma": 10e3,
        "observation.nuisance_scale": 1e3,
    }
)
"""The same with the carrier unknown to 10 kHz, four times the largest Doppler shift."""
