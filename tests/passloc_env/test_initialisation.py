"""Priors: where a belief begins, how wide, and what of it is true."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from passloc_env.angles import direction, wrap
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.nuisance import Nuisance
from passloc_env.platforms import FixedStation, Pose
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, Doppler, Sensor
from passloc_env.tracking import CoursePrior, Prior, RangePrior, StatePrior
from passloc_env.tracking.initialisation import FirstLook, polar_covariance

SIGMA = 0.02
SENSORS: tuple[Sensor, ...] = (Doppler(sigma=1.0, carrier=1e9), Bearing(sigma=SIGMA))
OWN = np.array([[300.0], [-200.0]])
RANGE, BEARING, SPEED, COURSE = 8e3, 2.0, 12.0, -1.0
SPREAD = RangePrior(range=10e3, range_sigma=3e3, velocity_sigma=50.0, acceleration_sigma=0.4, sensor=1)
INBOUND = CoursePrior(
    range_sigma=2e3, speed_sigma=2.0, course_sigma=0.5, min_range=5e3, min_speed=9.0, acceleration_sigma=0.4, sensor=1
)
AROUND = StatePrior(position_sigma=700.0, velocity_sigma=30.0, acceleration_sigma=0.4)
PRIORS = [SPREAD, INBOUND, AROUND]
IDS = ["range", "course", "state"]
MEASURED = 1.9
"""The bearing that the first look reports; the true one is 2.0."""


def first_look(prior: Prior, environments: int = 1, order: int = 1, seed: int | None = None) -> FirstLook:
    """One emitter and one measurement; with a seed, random bearing noise and normals, else none."""
    layout = StateLayout(2, order, ("carrier_offset",))
    truth = np.zeros((layout.size, environments))
    truth[layout.position] = OWN + RANGE * direction(np.full(environments, BEARING))
    truth[layout.velocity] = SPEED * direction(np.full(environments, COURSE))
    normals = np.zeros((prior.normals_needed(layout), environments))
    bearing = np.full(environments, MEASURED)
    if seed is not None:
        rng = np.random.default_rng(seed)
        normals = rng.standard_normal(normals.shape)
        bearing = BEARING + SIGMA * rng.standard_normal(environments)
    return FirstLook(
        layout=layout,
        truth=truth,
        measurement=np.stack([np.full(environments, 99.0), bearing]),
        suite=SensorSuite(SENSORS),
        poses=[Pose(*(OWN * np.ones(environments) for _ in range(3)))],
        normals=normals,
        nuisances=(Nuisance("carrier_offset", 5.0),),
    )


def polar(bearing: float, along: float, across: float) -> np.ndarray:
    """A covariance with these standard deviations along and across a compass bearing, by rotation."""
    axes = np.array([[math.sin(bearing), math.cos(bearing)], [math.cos(bearing), -math.sin(bearing)]])
    return axes.T @ np.diag([along**2, across**2]) @ axes


def blocks(covariance: np.ndarray, layout: StateLayout) -> tuple[np.ndarray, np.ndarray]:
    """The position and velocity blocks, everything that couples them with others being zero."""
    position, velocity = (covariance[b, b, 0] for b in (layout.position, layout.velocity))
    rest = covariance[..., 0].copy()
    rest[layout.position, layout.position] = rest[layout.velocity, layout.velocity] = 0.0
    np.testing.assert_array_equal(rest, np.diag(np.diag(rest)))
    return position, velocity


def test_polar_covariance() -> None:
    bearings = np.linspace(-3.0, 3.0, 7)
    found = polar_covariance(bearings, 5.0, np.arange(1.0, 8.0))
    for column, bearing in enumerate(bearings):
        np.testing.assert_allclose(found[..., column], polar(bearing, 5.0, column + 1.0), rtol=1e-12, atol=1e-12)


def test_range_prior_lies_along_the_measured_bearing() -> None:
    look = first_look(SPREAD)
    mean, covariance = SPREAD.start(look)
    position, velocity = blocks(covariance, look.layout)
    np.testing.assert_allclose(mean[:2], OWN + 10e3 * direction(np.array([MEASURED])))
    np.testing.assert_array_equal(mean[2:], 0.0)
    np.testing.assert_allclose(position, polar(MEASURED, 3e3, 10e3 * SIGMA), rtol=1e-9)
    np.testing.assert_array_equal(velocity, np.diag([2500.0, 2500.0]))


def test_range_prior_at_the_truth_uses_true_bearing_and_range() -> None:
    look = first_look(SPREAD)
    position, velocity = blocks(SPREAD.at_truth(look), look.layout)
    np.testing.assert_allclose(position, polar(BEARING, 3e3, RANGE * SIGMA), rtol=1e-9)
    np.testing.assert_array_equal(velocity, np.diag([2500.0, 2500.0]))


@pytest.mark.parametrize(
    ("normals", "distance", "speed"),
    [((0.0, 0.0), 8e3, 12.0), ((0.5, -1.0), 9e3, 10.0), ((-9.0, -9.0), 5e3, 9.0)],
    ids=["truth", "scattered", "never below the minima"],
)
def test_course_prior_believes_in_an_inbound_emitter(
    normals: tuple[float, float], distance: float, speed: float
) -> None:
    look = replace(first_look(INBOUND), normals=np.array(normals)[:, None])
    mean, covariance = INBOUND.start(look)
    position, velocity = blocks(covariance, look.layout)
    towards = direction(np.array([MEASURED]))
    np.testing.assert_allclose(mean[:2], OWN + distance * towards)
    np.testing.assert_allclose(mean[2:4], -speed * towards)
    np.testing.assert_allclose(position, polar(MEASURED, 2e3, distance * SIGMA), rtol=1e-9)
    np.testing.assert_allclose(velocity, polar(MEASURED + np.pi, 2.0, speed * 0.5), rtol=1e-9)


def test_course_prior_at_the_truth_uses_true_bearing_range_and_speed() -> None:
    look = replace(first_look(INBOUND), normals=np.full((2, 1), 3.0))
    position, velocity = blocks(INBOUND.at_truth(look), look.layout)
    np.testing.assert_allclose(position, polar(BEARING, 2e3, RANGE * SIGMA), rtol=1e-9)
    np.testing.assert_allclose(velocity, polar(BEARING + np.pi, 2.0, SPEED * 0.5), rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_state_prior_scatters_every_axis(order: int) -> None:
    look = first_look(AROUND, order=order)
    needed = AROUND.normals_needed(look.layout)
    assert needed == 2 * (order + 1)
    look.normals = np.arange(1.0, needed + 1.0)[:, None]
    mean, covariance = AROUND.start(look)
    sigma = np.repeat([700.0, 30.0, 0.4], 2)[:needed]
    np.testing.assert_allclose(mean[:needed, 0] - look.truth[:needed, 0], sigma * look.normals[:, 0], rtol=1e-9)
    np.testing.assert_array_equal(mean[needed:], 0.0)
    np.testing.assert_allclose(np.diag(covariance[..., 0]), [*(sigma**2), 25.0])
    np.testing.assert_array_equal(covariance, AROUND.at_truth(look))


@pytest.mark.parametrize("prior", PRIORS, ids=IDS)
@pytest.mark.parametrize("at", [lambda prior, look: prior.start(look)[1], lambda prior, look: prior.at_truth(look)])
def test_accelerations_and_nuisances_have_their_own_variances(prior: Any, at: Callable[..., np.ndarray]) -> None:
    look = first_look(prior, order=2)
    variances = np.diag(at(prior, look)[..., 0])
    np.testing.assert_allclose(variances[look.layout.acceleration], 0.16)
    np.testing.assert_allclose(variances[look.layout.nuisances], 25.0)


DRAWS = 20_000


@pytest.mark.parametrize("prior", [INBOUND, AROUND], ids=["course", "state"])
def test_scatter_around_the_truth_has_the_claimed_moments(prior: Any) -> None:
    """Position errors over seeds: mean zero and the covariance at the truth.

    Four standard errors each, missed by chance in one seed of a thousand for all entries together; and 3 % for what
    the bearing's noise bends (σ² = 4e-4) and, for the course prior, for spreading across at the drawn range.
    """
    prior = replace(prior, min_range=1.0) if prior is INBOUND else prior
    look = first_look(prior, DRAWS, seed=4)
    error = (prior.start(look)[0] - look.truth)[:2]
    axes = np.array([[math.sin(BEARING), math.cos(BEARING)], [math.cos(BEARING), -math.sin(BEARING)]])
    error = axes @ error
    expected = axes @ prior.at_truth(look)[:2, :2, 0] @ axes.T
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_array_less(np.abs(error.mean(axis=1)) / sigma, 4.0 / math.sqrt(DRAWS) + 1e-3)
    correlation = np.cov(error) / np.outer(sigma, sigma)
    expected_correlation = expected / np.outer(sigma, sigma)
    # Across, the drawn range r(1 + ε) with ε = 0.25 widens the variance by ε² = 6 %.
    widened = np.diag([0.0, (prior.range_sigma / RANGE) ** 2]) if prior is not AROUND else 0.0
    np.testing.assert_allclose(correlation, expected_correlation + widened, atol=4.0 * math.sqrt(2.0 / DRAWS) + 0.01)


def test_range_prior_covers_the_bearing_error() -> None:
    look = first_look(SPREAD, DRAWS, seed=5)
    mean, covariance = SPREAD.start(look)
    offset = mean[:2] - OWN
    across = np.array([math.cos(BEARING), -math.sin(BEARING)]) @ offset
    # The standard error of a standard deviation from 20 000 draws is 0.5 %.
    assert across.std() == pytest.approx(10e3 * SIGMA, rel=0.02)
    np.testing.assert_allclose(np.hypot(*offset), 10e3)
    assert np.linalg.eigvalsh(np.moveaxis(covariance[:2, :2], -1, 0)).min() == pytest.approx((10e3 * SIGMA) ** 2)


def test_drawn_ranges_and_speeds_have_the_claimed_spread() -> None:
    prior = replace(INBOUND, min_range=1.0, min_speed=0.1)
    mean, _ = prior.start(first_look(prior, DRAWS, seed=6))
    distance, speed = np.hypot(*(mean[:2] - OWN)), np.hypot(*mean[2:4])
    # Four standard errors: 2.8 % of a standard deviation for the mean, 2 % for the spread.
    for found, centre, sigma in ((distance, RANGE, 2e3), (speed, SPEED, 2.0)):
        assert found.mean() == pytest.approx(centre, abs=0.028 * sigma)
        assert found.std() == pytest.approx(sigma, rel=0.02)
    course = np.arctan2(mean[2], mean[3])
    bearing = np.arctan2(*(mean[:2] - OWN))
    np.testing.assert_allclose(wrap(course - bearing - np.pi), 0.0, atol=1e-9)


@pytest.mark.parametrize("prior", PRIORS, ids=IDS)
def test_bits_do_not_depend_on_the_batch(prior: Any, assert_batch_free: Callable[..., None]) -> None:
    whole = first_look(prior, 300, seed=7)

    def begin(truth: np.ndarray, measurement: np.ndarray, normals: np.ndarray, position: np.ndarray) -> np.ndarray:
        look = replace(
            whole, truth=truth, measurement=measurement, normals=normals, poses=[Pose(position, position, position)]
        )
        mean, covariance = prior.start(look)
        flat = [c.reshape(-1, c.shape[-1]) for c in (mean, covariance, prior.at_truth(look))]
        return np.concatenate(flat)

    assert_batch_free(begin, whole.truth, whole.measurement, whole.normals, whole.pose.position)


@pytest.mark.parametrize("prior", [SPREAD, INBOUND], ids=["range", "course"])
def test_priors_start_from_the_platform_that_heard_the_bearing(prior: Any) -> None:
    sensors = (SENSORS[0], Bearing(sigma=1.0, platform=3))
    assert prior.carrier_platform(sensors) == 3


@pytest.mark.parametrize("prior", [SPREAD, INBOUND], ids=["range", "course"])
@pytest.mark.parametrize(
    ("sensors", "dimension"), [(SENSORS[:1], 2), (SENSORS[::-1], 2), (SENSORS, 3)], ids=["none", "Doppler", "space"]
)
def test_priors_from_a_bearing_need_one_and_a_plane(prior: Any, sensors: tuple[Sensor, ...], dimension: int) -> None:
    prior.check(SENSORS, (), 2)
    with pytest.raises(ScenarioError) as caught:
        prior.check(sensors, (), dimension)
    assert caught.value.field == "sensor"


def test_state_prior_fits_everywhere() -> None:
    station = FixedStation(position=(0.0, 0.0, 0.0))
    AROUND.check((), (station,), station.dimension)
    assert AROUND.normals_needed(StateLayout(3, 2)) == 9
