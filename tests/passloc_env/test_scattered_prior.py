"""The scattered prior: a belief drawn around the truth with the covariance it claims."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from passloc_env.angles import direction
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.linalg import unsound
from passloc_env.metrics import nees
from passloc_env.motion import ConstantAcceleration
from passloc_env.nuisance import Nuisance
from passloc_env.platforms import FixedStation, PlanarPose, Pose, TurnLimitedPlatform
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, Doppler, Sensor
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, PolarStart, Target
from passloc_env.tracking import Prior, RangePrior, ScatteredPrior, UnscentedKalman
from passloc_env.tracking.initialisation import THINNEST, FirstLook

SIGMA, RANGE, BEARING = 0.02, 8e3, 2.0
SENSORS: tuple[Sensor, ...] = (Doppler(sigma=1.0, carrier=1e9), Bearing(sigma=SIGMA))
OWN = np.array([[300.0], [-200.0]])
VELOCITY, ACCELERATION = (12.0, -7.0), (0.3, 0.2)
PRIOR = ScatteredPrior(range_sigma=600.0, velocity_sigma=3.0, acceleration_sigma=0.05, sensor=1)


def first_look(environments: int = 1, order: int = 1, seed: int | None = None) -> FirstLook:
    """One emitter and one measurement; with a seed, random bearing noise and normals, else none."""
    layout = StateLayout(2, order, ("carrier_offset",))
    truth = np.zeros((layout.size, environments))
    truth[layout.position] = OWN + RANGE * direction(np.full(environments, BEARING))
    truth[layout.velocity] = np.array(VELOCITY)[:, None]
    if order == 2:
        truth[layout.acceleration] = np.array(ACCELERATION)[:, None]
    rng = np.random.default_rng(seed or 0)
    scale = 0.0 if seed is None else 1.0
    normals = scale * rng.standard_normal((PRIOR.normals_needed(layout), environments))
    bearing = BEARING + scale * SIGMA * rng.standard_normal(environments)
    return FirstLook(
        layout=layout,
        truth=truth,
        measurement=np.stack([np.full(environments, 99.0), bearing]),
        suite=SensorSuite(SENSORS),
        poses=[Pose(*(OWN * np.ones(environments) for _ in range(3)))],
        normals=normals,
        nuisances=(Nuisance("carrier_offset", 5.0),),
    )


def along_and_across(covariance: np.ndarray) -> np.ndarray:
    """The position block turned to the true line of sight."""
    axes = np.array([[math.sin(BEARING), math.cos(BEARING)], [math.cos(BEARING), -math.sin(BEARING)]])
    turned: np.ndarray = axes @ covariance[:2, :2] @ axes.T
    return turned


@pytest.mark.parametrize("order", [1, 2])
def test_without_scatter_it_is_the_truth_along_the_measured_bearing(order: int) -> None:
    look = first_look(order=order)
    look.measurement[1] = 1.9
    mean, covariance = PRIOR.start(look)
    assert PRIOR.normals_needed(look.layout) == 1 + 2 * order
    np.testing.assert_allclose(mean[:2], OWN + RANGE * direction(np.array([1.9])))
    np.testing.assert_array_equal(mean[2:-1], look.truth[2:-1])
    assert mean[-1] == 0.0
    expected = [*(9.0, 9.0, 0.05**2, 0.05**2)[: 2 * order], 25.0]
    np.testing.assert_allclose(np.diag(covariance[..., 0])[2:], expected)
    values = np.linalg.eigvalsh(covariance[:2, :2, 0])
    np.testing.assert_allclose(values, [(RANGE * SIGMA) ** 2, 600.0**2], rtol=1e-9)
    assert not covariance[:2, 2:].any()


@pytest.mark.parametrize("order", [1, 2])
def test_every_normal_scatters_its_own_state(order: int) -> None:
    look = first_look(order=order)
    look.normals = np.arange(1.0, 2.0 + 2 * order)[:, None]
    mean, _ = PRIOR.start(look)
    np.testing.assert_allclose(mean[:2], OWN + (RANGE + 600.0) * direction(np.array([BEARING])))
    sigma = np.array([3.0, 3.0, 0.05, 0.05])[: 2 * order]
    np.testing.assert_allclose((mean - look.truth)[2:-1, 0], sigma * look.normals[1:, 0])


def test_ranges_never_fall_below_the_smallest() -> None:
    prior, look = replace(PRIOR, min_range=1.5e3), first_look()
    look.normals[0] = -100.0
    mean, covariance = prior.start(look)
    np.testing.assert_allclose(np.hypot(*(mean[:2] - OWN)), 1.5e3)
    across = along_and_across(covariance[..., 0])[1, 1]
    assert across == pytest.approx((1.5e3 * SIGMA) ** 2)


def test_beliefs_right_beside_the_array_can_be_factored() -> None:
    """A millimetre across and 60 km along, on any bearing, asked for; what is given has pivots that are no rounding."""
    look = first_look(500, seed=3)
    look.measurement[1] = np.linspace(-math.pi, math.pi, 500)
    look.normals[0] = -100.0
    _, covariance = replace(PRIOR, range_sigma=60e3, min_range=0.05).start(look)
    assert not unsound(covariance).any()


def test_no_shipped_prior_is_widened() -> None:
    """At the smallest range that it draws, every one is as thin as its bearing says."""
    priors = [(s.prior, s.sensors[s.prior.sensor]) for s in SCENARIOS.values() if isinstance(s.prior, ScatteredPrior)]
    assert len(priors) == 5
    for prior, sensor in priors:
        assert isinstance(sensor, Bearing)
        assert prior.min_range * sensor.sigma > THINNEST * prior.range_sigma


@pytest.mark.parametrize("order", [1, 2])
def test_at_the_truth(order: int) -> None:
    """True bearing and range, whatever was measured and drawn."""
    look = first_look(order=order)
    look.measurement[1] = -1.0
    look.normals[:] = 3.0
    covariance = PRIOR.at_truth(look)[..., 0]
    expected = np.diag([600.0**2, (RANGE * SIGMA) ** 2])
    np.testing.assert_allclose(along_and_across(covariance), expected, atol=1e-6)
    rest = [9.0] * 2 + [0.05**2] * (2 * order - 2) + [25.0]
    np.testing.assert_allclose(covariance[2:, 2:], np.diag(rest))
    assert not covariance[:2, 2:].any()


DRAWS = 20_000


@pytest.mark.parametrize("order", [1, 2])
def test_errors_have_the_covariance_claimed(order: int) -> None:
    """Over 20 000 draws, in units of the claimed standard deviations.

    Five standard errors of a sample covariance, √(2/n) at most: missed by chance once in 50 000 seeds for all entries.
    Besides, across the line of sight the drawn range widens the variance by (σ_r/r)² = 0.6 %, and the bend of the
    circle adds (r σ_θ²)² ≪ σ_r² along it.
    """
    look = first_look(DRAWS, order, seed=4)
    mean, covariance = PRIOR.start(look)
    error = (mean - look.truth)[:-1]
    claimed = PRIOR.at_truth(look)[:-1, :-1, 0]
    whiten = np.linalg.inv(np.linalg.cholesky(claimed))
    white = whiten @ error
    np.testing.assert_allclose(np.cov(white), np.eye(len(white)), atol=5.0 * math.sqrt(2.0 / DRAWS) + 0.006)
    np.testing.assert_allclose(white.mean(axis=1), 0.0, atol=5.0 / math.sqrt(DRAWS) + SIGMA**2 * RANGE / 600.0)
    # What each episode claims of itself is the same on average: r² + σ_r² across.
    typical = along_and_across(covariance.mean(axis=-1))
    np.testing.assert_allclose(np.diag(typical), [600.0**2, (RANGE**2 + 600.0**2) * SIGMA**2], rtol=0.01)


@pytest.mark.parametrize("order", [1, 2])
def test_beliefs_begin_consistent(order: int, begin: Callable[..., Simulation]) -> None:
    """In the simulation, with a random emitter heard by the second platform: NEES of 2000 episodes is χ².

    A range known to 5 % and bearings to 3 mrad bend it by 1 %, which 2000 draws do not see. False alarm 1e-3.
    """
    motion = ConstantAcceleration() if order == 2 else Scenario().tracker.motion
    aircraft = TurnLimitedPlatform(position=(5e3, -9e3), speed=200.0, max_turn_rate=0.05)
    scenario = Scenario().replace(
        platforms=(FixedStation(position=(0.0, 0.0)), aircraft),
        sensors=(Doppler(sigma=10.0, carrier=1e9, carrier_sigma=300.0), Bearing(sigma=3e-3, platform=1)),
        prior=replace(PRIOR, range_sigma=1e3),
        tracker=UnscentedKalman(motion=motion),
    )
    start = PolarStart(range=40e3, bearing={"type": "Uniform", "low": -3.0, "high": 3.0}, speed=100.0, course=0.5)
    simulation = begin(scenario.override({"target.start": start, "target.motion": motion}), 2000)
    layout = simulation.models.tracker.layout
    assert layout.size == 2 * (order + 1) + 1
    found = nees(simulation.track.mean - simulation.truth, simulation.track.covariance)
    assert stats.kstest(found, stats.chi2(layout.size).cdf).pvalue > 1e-3


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    whole = first_look(300, 2, seed=7)

    def begin(truth: np.ndarray, measurement: np.ndarray, normals: np.ndarray, position: np.ndarray) -> np.ndarray:
        own = [Pose(position, position, position)]
        look = replace(whole, truth=truth, measurement=measurement, normals=normals, poses=own)
        mean, covariance = PRIOR.start(look)
        return np.concatenate([c.reshape(-1, c.shape[-1]) for c in (mean, covariance, PRIOR.at_truth(look))])

    assert_batch_free(begin, whole.truth, whole.measurement, whole.normals, whole.pose.position)


def test_it_starts_from_the_platform_that_heard_the_bearing() -> None:
    assert PRIOR.carrier_platform((SENSORS[0], Bearing(sigma=1.0, platform=3))) == 3


def in_space() -> Scenario:
    """A scenario in space, where a bearing is no direction."""
    still = (0.0, 0.0, 0.0)
    return Scenario(
        target=Target(start=CartesianStart(position=(30e3, 0.0, 0.0), velocity=still)),
        platforms=(FixedStation(position=still),),
        prior=replace(PRIOR, sensor=0),
    )


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: Scenario().replace(prior=PRIOR), "prior.sensor"),
        (lambda: Scenario().replace(prior=replace(PRIOR, sensor=0), sensors=SENSORS), "prior.sensor"),
        (in_space, "prior.sensor"),
        (lambda: replace(PRIOR, range_sigma=0.0), "range_sigma"),
        (lambda: replace(PRIOR, velocity_sigma=-1.0), "velocity_sigma"),
        (lambda: replace(PRIOR, acceleration_sigma=0.0), "acceleration_sigma"),
        (lambda: replace(PRIOR, min_range=0.0), "min_range"),
    ],
    ids=["no such sensor", "not a bearing", "in space", "range", "velocity", "acceleration", "smallest range"],
)
def test_what_is_impossible(build: Callable[[], object], field: str, refusal: Callable[..., ScenarioError]) -> None:
    assert refusal(build).field == field


@pytest.mark.parametrize("prior", [PRIOR, RangePrior(range=8e3, range_sigma=600.0, velocity_sigma=3.0, sensor=1)])
def test_the_first_bearing_is_drawn_from_where_it_was_taken(prior: Prior) -> None:
    """The array sits a kilometre ahead of its platform, which heads east."""
    look = first_look()
    arm = Bearing(sigma=SIGMA, lever_arm=(1e3, 0.0))
    place = OWN + np.array([[1e3], [0.0]])
    look.suite = SensorSuite((SENSORS[0], arm))
    look.poses = [PlanarPose(OWN, np.zeros((2, 1)), np.full(1, math.pi / 2), np.zeros(1))]
    look.truth[:2] = place + RANGE * direction(np.array([BEARING]))
    mean, covariance = prior.start(look)
    np.testing.assert_allclose(mean[:2], look.truth[:2], atol=1e-6)
    np.testing.assert_allclose(prior.at_truth(look), covariance, atol=1e-6)


def test_from_the_outer_array_of_a_vessel_the_belief_is_as_good_as_it_says(begin: Callable[..., Simulation]) -> None:
    """NEES of the position from array 2, a kilometre off: χ² of two degrees (false alarm 1e-3)."""
    simulation = begin(SCENARIOS["DualArray"].override({"prior.sensor": 1}), 400)
    error = simulation.track.mean[:2] - simulation.truth[:2]
    found = nees(error, simulation.track.covariance[:2, :2])
    assert stats.kstest(found, stats.chi2(2).cdf).pvalue > 1e-3
