"""The single-satellite fix of an emitter that the satellite does not hear, and where fixes are drawn from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pymap3d
import pytest

from passloc_env.distributions import Uniform
from passloc_env.errors import ScenarioError
from passloc_env.frames import EARTH_RADIUS
from passloc_env.metrics import nees
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensors import PhaseDifference
from passloc_env.simulation import Simulation
from passloc_env.units import DEGREE

SCENARIO = SCENARIOS["DualSatellite"]
ANTIPODES = SCENARIO.override({"target.start.latitude": -40.0 * DEGREE})
ALTITUDE = 700e3
HORIZON = math.sqrt((EARTH_RADIUS + ALTITUDE) ** 2 - EARTH_RADIUS**2)


def test_an_emitter_below_the_horizon_is_not_fixed_through_the_earth(begin: Callable[..., Simulation]) -> None:
    """Where the satellite is, and as uncertain as its horizon is wide; the bound says the same."""
    simulation = begin(ANTIPODES, 5)
    own = simulation.poses()[0].position
    latitude, longitude, height = pymap3d.ecef2geodetic(*simulation.track.mean[:3], deg=False)
    there = pymap3d.ecef2geodetic(*own, deg=False)
    np.testing.assert_allclose((latitude, longitude), there[:2], atol=1e-9)
    np.testing.assert_allclose(height, SCENARIO.prior.height, atol=1e-3)  # type: ignore[attr-defined]
    for covariance in (simulation.track.covariance, simulation.information.bound):
        sigma = np.sqrt(covariance[[0, 1, 2], [0, 1, 2]])
        np.testing.assert_allclose(sigma, HORIZON, rtol=1e-9)
    error = simulation.track.mean[:3] - simulation.truth[:3]
    assert (np.linalg.norm(error, axis=0) > 4e6).all()
    # Within three deviations along every axis, where the fix was 500 of its own deviations away.
    assert (nees(error, simulation.track.covariance[:3, :3]) < 3.0 * 9.0).all()


def test_unheard_to_the_end_nothing_is_gained(begin: Callable[..., Simulation]) -> None:
    simulation = begin(ANTIPODES, 3)
    before = simulation.information.bound[0, 0].copy()
    for _ in range(4):
        simulation.step(np.zeros((6, 3)))
        assert simulation.detected is not None
        assert not simulation.detected.any()
        assert (simulation.information.bound[0, 0] >= before).all()
        assert np.isfinite(simulation.reward).all()
        assert np.abs(simulation.reward).max() < 1.0
    assert not simulation.track.repairs.any()


def test_each_environment_is_heard_or_not_by_itself(begin: Callable[..., Simulation]) -> None:
    """Half of the first looks miss a phase by chance: those begin below the satellite, the others with the fix."""
    scenario = SCENARIO.override({"sensors.1.detection_probability": 0.5})
    simulation, always = begin(scenario, 40), begin(SCENARIO, 40)
    missed = simulation.track.covariance[0, 0] > (0.9 * HORIZON) ** 2
    assert 8 < missed.sum() < 32  # false alarm 1e-4
    np.testing.assert_array_equal(simulation.track.mean[:, ~missed], always.track.mean[:, ~missed])
    np.testing.assert_array_equal(simulation.information.bound[..., ~missed], always.information.bound[..., ~missed])
    np.testing.assert_allclose(simulation.information.bound[0, 0, missed], HORIZON**2, rtol=1e-9)


def test_a_fix_is_drawn_from_the_interferometers(begin: Callable[..., Simulation]) -> None:
    """Both of them 200 km ahead of the satellite's centre, without noise to speak of: the fix is the emitter."""
    sensors = tuple(
        replace(sensor, lever_arm=(200e3, 0.0, 0.0), sigma=1e-9, misalignment_sigma=0.0)
        if isinstance(sensor, PhaseDifference)
        else sensor
        for sensor in SCENARIO.sensors
    )
    simulation = begin(SCENARIO.replace(sensors=sensors), 5)
    np.testing.assert_allclose(simulation.track.mean[:3], simulation.truth[:3], atol=1.0)


@pytest.mark.parametrize("height", [ALTITUDE, 2e6, Uniform(low=10e3, high=ALTITUDE)])
def test_the_height_is_below_the_orbit(height: object, refusal: Callable[..., ScenarioError]) -> None:
    assert refusal(lambda: SCENARIO.override({"prior.height": height})).field == "prior.height"
    assert isinstance(SCENARIO.override({"prior.height": 0.99 * ALTITUDE}), Scenario)
