"""The prior of a known region: the same belief whatever is heard first, whatever is true."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from passloc_env.distributions import Uniform
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.nuisance import Nuisance
from passloc_env.platforms import FixedStation, Pose
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, TimeDifference
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart
from passloc_env.tracking import PlacePrior
from passloc_env.tracking.initialisation import FirstLook

PLACE = (400.0, -300.0, 50.0)


def prior_in(dimension: int) -> PlacePrior:
    return PlacePrior(position=PLACE[:dimension], position_sigma=200.0, velocity_sigma=3.0, acceleration_sigma=0.2)


def first_look(dimension: int, order: int, environments: int = 4, seed: int = 0) -> FirstLook:
    """Random truths and measurements, of which nothing may show in the prior."""
    layout = StateLayout(dimension, order, ("carrier_offset",))
    rng = np.random.default_rng(seed)
    return FirstLook(
        layout=layout,
        truth=rng.normal(0.0, 1e3, (layout.size, environments)),
        measurement=rng.normal(size=(1, environments)),
        suite=SensorSuite((Bearing(sigma=0.1),)),
        poses=[Pose(*rng.normal(0.0, 1e3, (2, dimension, environments)))],
        normals=np.zeros((0, environments)),
        nuisances=(Nuisance("carrier_offset", 5.0),),
    )


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dimension", [2, 3])
def test_place_and_spread(dimension: int, order: int) -> None:
    prior, look = prior_in(dimension), first_look(dimension, order)
    mean, covariance = prior.start(look)
    expected = [*PLACE[:dimension], *[0.0] * (dimension * order), 0.0]
    np.testing.assert_array_equal(mean, np.array(expected)[:, None] * np.ones(4))
    sigmas = [*[200.0] * dimension, *[3.0] * dimension, *[0.2] * (dimension * (order - 1)), 5.0]
    np.testing.assert_allclose(covariance, np.diag(np.square(sigmas))[..., None] * np.ones(4), rtol=1e-15)
    np.testing.assert_array_equal(prior.at_truth(look), covariance)
    assert prior.normals_needed(look.layout) == 0


def test_nothing_heard_or_true_matters() -> None:
    prior = prior_in(2)
    for found, other in zip(prior.start(first_look(2, 2)), prior.start(first_look(2, 2, seed=1)), strict=True):
        np.testing.assert_array_equal(found, other)


def realised(size: int) -> PlacePrior:
    """A prior whose quantities differ between environments."""
    rng = np.random.default_rng(5)
    prior = replace(prior_in(2))
    object.__setattr__(prior, "position", (rng.normal(size=size), 7.0))
    object.__setattr__(prior, "position_sigma", rng.uniform(1.0, 2.0, size))
    object.__setattr__(prior, "velocity_sigma", rng.uniform(3.0, 4.0, size))
    return prior


def test_environments_have_their_own_places() -> None:
    prior = realised(4)
    mean, covariance = prior.start(first_look(2, 1))
    np.testing.assert_array_equal(mean[:2], [prior.position[0], np.full(4, 7.0)])
    for axis in range(2):
        np.testing.assert_array_equal(covariance[axis, axis], prior.position_sigma**2)
        np.testing.assert_array_equal(covariance[2 + axis, 2 + axis], prior.velocity_sigma**2)


def test_a_place_may_be_drawn(begin: Callable[..., Simulation]) -> None:
    """Anew for each environment, within its limits; tracker and bound begin from the same spread."""
    changes: dict[str, Any] = {
        "prior.position": (Uniform(low=100.0, high=200.0), 500.0),
        "prior.position_sigma": Uniform(low=250.0, high=300.0),
    }
    simulation = begin(SCENARIOS["CrossFix"].override(changes), 50)
    east, north = simulation.track.mean[:2]
    assert (east > 100.0).all()
    assert (east < 200.0).all()
    assert len(np.unique(east)) == 50
    np.testing.assert_array_equal(north, 500.0)
    np.testing.assert_array_equal(simulation.information.bound, simulation.track.covariance)
    sigma = np.sqrt(simulation.track.covariance[0, 0])
    assert 250.0 <= sigma.min() < sigma.max() <= 300.0


def test_it_needs_no_bearing_and_no_plane(begin: Callable[..., Simulation]) -> None:
    """Three time differences in space, from the prior's place to the emitter's neighbourhood."""
    corners = ((0.0, 0.0, 0.0), (9e3, 0.0, 500.0), (0.0, 9e3, 0.0), (9e3, 9e3, 2e3))
    scenario = Scenario().override(
        {
            "target.start": CartesianStart(position=(4e3, 5e3, 3e3), velocity=(0.0, 0.0, 0.0)),
            "platforms": [FixedStation(position=corner) for corner in corners],
            "sensors": [TimeDifference(sigma=1e-8, other=other) for other in (1, 2, 3)],
            "prior": PlacePrior(position=(4.5e3, 4.5e3, 2e3), position_sigma=1e3, velocity_sigma=10.0),
            "episode.min_range": 0.0,
        }
    )
    simulation = begin(scenario, 3)
    np.testing.assert_array_equal(simulation.track.mean[:3], np.array([[4.5e3], [4.5e3], [2e3]]) * np.ones(3))
    before = simulation.outcome.relative_range_error
    for _ in range(20):
        simulation.step(np.zeros((0, 3)))
    assert (simulation.outcome.relative_range_error < 0.05 * before).all()


@pytest.mark.parametrize("position", [(0.0,), (0.0, 0.0, 0.0), ()])
def test_the_place_has_the_axes_of_the_problem(
    position: tuple[float, ...], refusal: Callable[..., ScenarioError]
) -> None:
    prior = PlacePrior(position=position, position_sigma=1.0, velocity_sigma=1.0)
    error = refusal(Scenario().override, {"prior": prior})
    assert (error.field, error.value, error.allowed) == ("prior.position", position, "must have 2 axes")


@pytest.mark.parametrize("field", ["position_sigma", "velocity_sigma", "acceleration_sigma"])
def test_spreads_are_above_zero(field: str, refusal: Callable[..., ScenarioError]) -> None:
    error = refusal(SCENARIOS["CrossFix"].override, {f"prior.{field}": 0.0})
    assert (error.field, error.value) == (f"prior.{field}", 0.0)


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    prior, look = realised(60), first_look(2, 2, environments=60)

    def start(east: np.ndarray, sigma: np.ndarray, truth: np.ndarray) -> np.ndarray:
        part = replace(prior_in(2))
        object.__setattr__(part, "position", (east, 7.0))
        object.__setattr__(part, "position_sigma", sigma)
        mean, covariance = part.start(replace(look, truth=truth))
        return np.concatenate([mean[:, None], covariance], axis=1)

    assert_batch_free(start, prior.position[0], prior.position_sigma, look.truth)
