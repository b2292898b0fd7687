"""The single-satellite fix: where it lands, how uncertain it is, and what it shares with the body's misalignment."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pymap3d
import pytest
from scipy import stats

from passloc_env import linalg
from passloc_env.errors import ScenarioError
from passloc_env.frames import EARTH_RADIUS, below_horizon
from passloc_env.layout import StateLayout
from passloc_env.metrics import nees
from passloc_env.platforms import CircularOrbit, FixedStation, Pose
from passloc_env.scenario import Episode, Scenario
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.sensors import PhaseDifference, Sensor, TimeDifference
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, GeodeticStart, Target
from passloc_env.tracking import ExtendedKalman, HeightPrior, StatePrior
from passloc_env.tracking.initialisation import FirstLook

ORBIT = CircularOrbit(inclination=1.0, argument_of_latitude=0.6)
SATELLITES = (replace(ORBIT, argument_of_latitude=0.5), ORBIT)
PHASE = partial(PhaseDifference, baseline=3.0, carrier=3e9, platform=1)
TILTED = 2e-4
"""Misalignment about each axis, rad: 0.15 km on the ground."""

# The prior's satellite is the second, and its interferometers stand neither first nor in order.
KNOWN: tuple[Sensor, ...] = (
    TimeDifference(sigma=1e-7),
    PHASE(sigma=0.08, axis=1),
    PHASE(sigma=0.08, axis=0, platform=0),
    PHASE(sigma=0.05, axis=0),
)
MISALIGNED: tuple[Sensor, ...] = tuple(
    replace(sensor, misalignment_sigma=TILTED) if isinstance(sensor, PhaseDifference) else sensor for sensor in KNOWN
)
PRIOR = HeightPrior(height=10e3, height_sigma=1e3, velocity_sigma=200.0, platform=1)
PLACE = (0.45, 0.38)
"""Latitude and longitude of the emitter, 300 km beside the ground track."""

SUITES = {"known attitude": KNOWN, "unknown misalignment": MISALIGNED}


def emitter(place: tuple[float, float], height: np.ndarray) -> np.ndarray:
    return np.array(pymap3d.geodetic2ecef(*(np.full(len(height), angle) for angle in place), height, deg=False))


def first_look(
    sensors: tuple[Sensor, ...],
    environments: int = 1,
    seed: int | None = None,
    height: float = 10e3,
    place: tuple[float, float] = PLACE,
    order: int = 1,
) -> FirstLook:
    """An emitter above a place; with a seed its height, velocity and misalignments are drawn, and the phases noisy."""
    named = nuisances(sensors)
    layout = StateLayout(3, order, tuple(nuisance.name for nuisance in named))
    rng = np.random.default_rng(seed or 0)
    scale = 0.0 if seed is None else 1.0
    truth = np.zeros((layout.size, environments))
    truth[:3] = emitter(place, height + scale * 1e3 * rng.standard_normal(environments))
    truth[3:6] = scale * 200.0 * rng.standard_normal((3, environments))
    truth[layout.nuisances] = scale * TILTED * rng.standard_normal((len(named), environments))
    poses = [orbit.pose(orbit.start(environments)) for orbit in SATELLITES]
    suite = SensorSuite(sensors)
    measurement = suite.measure(Scene(truth, layout, poses))
    measurement += suite.noise(scale * rng.standard_normal(measurement.shape))
    return FirstLook(layout, truth, measurement, suite, poses, np.zeros((0, environments)), named, carrier=1)


@pytest.fixture(params=SUITES.values(), ids=list(SUITES))
def sensors(request: pytest.FixtureRequest) -> tuple[Sensor, ...]:
    found: tuple[Sensor, ...] = request.param
    return found


def test_without_noise_the_fix_is_the_emitter(sensors: tuple[Sensor, ...]) -> None:
    """Rounding of 7e6 m, and the phases' 200 rad to 1e-14 of themselves; at rest, and aligned."""
    look = first_look(sensors, 3)
    mean, _ = PRIOR.start(look)
    np.testing.assert_allclose(mean[:3], look.truth[:3], atol=1e-6)
    assert not mean[3:].any()
    assert PRIOR.normals_needed(look.layout) == 0


@pytest.mark.parametrize("wrong", [-2e3, 3e3])
def test_a_wrong_height_moves_the_fix_along_the_line(wrong: float) -> None:
    look = first_look(KNOWN, 1, height=10e3 + wrong)
    mean, _ = PRIOR.start(look)
    found = pymap3d.ecef2geodetic(*mean[:3, 0], deg=False)[2]
    assert found == pytest.approx(10e3, abs=1e-6)
    own = look.poses[1].position[:, 0]
    line, offset = look.truth[:3, 0] - own, mean[:3, 0] - own
    np.testing.assert_allclose(np.cross(offset, line) / np.linalg.norm(line), 0.0, atol=1e-6)
    assert math.copysign(1.0, np.linalg.norm(offset) - np.linalg.norm(line)) == math.copysign(1.0, wrong)


# Covariance.


def expected_covariance(look: FirstLook, sensors: tuple[Sensor, ...], prior: HeightPrior = PRIOR) -> np.ndarray:
    """``A diag(σ²) Aᵀ`` for the errors of phases, height, misalignments and velocity, by numerical gradients."""
    n = look.layout.size
    state, rows = look.truth[:, :1], [1, 3]
    poses = [
        Pose(*(getattr(p, k)[..., :1] for k in ("position", "velocity", "acceleration", "attitude")))
        for p in look.poses
    ]

    def known(x: np.ndarray) -> np.ndarray:
        phases = look.suite.measure(Scene(x[:, None], look.layout, poses))[rows, 0]
        return np.array([*phases, pymap3d.ecef2geodetic(*x[:3], deg=False)[2]])

    slopes = np.zeros((3, n))
    for row, step in enumerate([10.0] * 3 + [1.0] * (n - 3)):
        move = np.zeros(n)
        move[row] = step if row < 6 else 1e-4
        slopes[:, row] = (known(state[:, 0] + move) - known(state[:, 0] - move)) / (2.0 * move[row])
    solve = np.linalg.inv(slopes[:, :3])
    rest = slice(6, n)
    # Errors of the mean: position by phases and height, and by the misalignment it takes for zero.
    gain = np.zeros((n, 3 + 3 + n - 6))
    gain[:3, :3] = solve
    gain[3:6, 3:6] = np.eye(3)
    gain[:3, 6:] = solve @ slopes[:, rest]
    gain[6:, 6:] = -np.eye(n - 6)
    sigma = np.array([0.08, 0.05, 1e3, *[200.0] * 3, *[TILTED] * (n - 6)])
    covariance: np.ndarray = (gain * sigma**2) @ gain.T
    return covariance


def assert_relative(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Covariances agree in units of the standard deviations."""
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=tolerance)


@pytest.mark.parametrize("place", [PLACE, (0.30, 0.55), (0.62, 0.12)])
def test_at_the_truth_it_is_what_the_gradients_say(sensors: tuple[Sensor, ...], place: tuple[float, float]) -> None:
    """Central differences over 10 m of 1000 km: 1e-10, and rounding of heights 1e-9 m / 20 m."""
    look = first_look(sensors, 2, place=place)
    found = PRIOR.at_truth(look)
    expected = expected_covariance(look, sensors)
    for column in range(2):
        assert_relative(found[..., column], expected, 1e-6)
    np.testing.assert_array_equal(found, found.swapaxes(0, 1))
    assert not linalg.unsound(found).any()


def test_at_the_truth_the_height_grows_as_it_does_there() -> None:
    """Also for an emitter 30 km above the assumed height and low in the sky, where the line meets that far behind."""
    place = (0.45, 0.75)
    look = first_look(KNOWN, 1, height=40e3, place=place)
    assert not below_horizon(look.poses[1].position, look.truth[:3]).any()
    assert_relative(PRIOR.at_truth(look)[..., 0], expected_covariance(look, KNOWN), 1e-6)


def test_at_the_truth_nothing_measured_counts() -> None:
    look = first_look(MISALIGNED, 2)
    covariance = PRIOR.at_truth(look)
    look.measurement[:] = 7.0
    np.testing.assert_array_equal(PRIOR.at_truth(look), covariance)


DRAWS = 20_000


def test_errors_have_the_covariance_claimed(sensors: tuple[Sensor, ...]) -> None:
    """Over 20 000 draws of noise, height, velocity and misalignment, cross terms included.

    Errors are whitened by the covariance at the truth. Five standard errors of a sample covariance, √(2/n), are missed
    by chance once in 10 000 seeds for all entries; the bend of the Earth and of the cosines adds 1 km / 500 km.
    """
    look = first_look(sensors, DRAWS, seed=1)
    mean, covariance = PRIOR.start(look)
    claimed = PRIOR.at_truth(first_look(sensors, 1))[..., 0]
    error = mean - look.truth
    white = np.linalg.solve(np.linalg.cholesky(claimed), error)
    np.testing.assert_allclose(np.cov(white), np.eye(len(white)), atol=5.0 * math.sqrt(2.0 / DRAWS) + 0.005)
    np.testing.assert_allclose(white.mean(axis=1), 0.0, atol=5.0 / math.sqrt(DRAWS) + 0.005)
    if look.layout.nuisance:
        # The belief and the misalignment that moved it lean on each other, own satellite's only.
        names = look.layout.nuisance
        own = [look.layout.nuisance_row(name) for name in names if name.endswith("_1")]
        other = [look.layout.nuisance_row(name) for name in names if name.endswith("_0")]
        sigma = np.sqrt(np.diag(claimed))
        ties = np.abs(claimed / np.outer(sigma, sigma))
        assert ties[:3, own].max() > 0.2
        assert not ties[:3, other].any()
    # What each look claims of itself varies with where it lands, by the same share.
    assert_relative(covariance.mean(axis=-1), claimed, 0.02)


def test_beliefs_begin_consistent(sensors: tuple[Sensor, ...]) -> None:
    """NEES over all states is χ² (2000 draws against the law, false alarm 1e-3)."""
    look = first_look(sensors, 2000, seed=2)
    mean, covariance = PRIOR.start(look)
    found = nees(mean - look.truth, covariance)
    assert stats.kstest(found, stats.chi2(look.layout.size).cdf).pvalue > 1e-3


@pytest.mark.parametrize("order", [1, 2])
def test_every_state_has_a_variance(order: int) -> None:
    """Whatever the motion holds as a state, the first belief is a positive definite one."""
    look = first_look(MISALIGNED, 3, order=order)
    for covariance in (PRIOR.start(look)[1], PRIOR.at_truth(look)):
        assert (linalg.diagonal(covariance) > 0.0).all()
        assert not linalg.unsound(covariance).any()


# Directions that miss the Earth.


@pytest.mark.parametrize("orbit", [CircularOrbit(inclination=0.0), ORBIT], ids=["equator", "inclined"])
def test_directions_that_miss_the_earth_begin_a_belief_all_the_same(orbit: CircularOrbit) -> None:
    """Above the horizon, level, and with cosines that no direction has: finite, sound, and no wider than the Earth."""
    cosines = np.array([[1.0, 0.95, 0.0, 0.6, 0.9, 1.2, -1.0, 0.0], [0.0, 0.0, -0.95, 0.7, 0.3, 0.4, 0.0, 1.0]])
    size = cosines.shape[1]
    pose = orbit.pose(orbit.start(size))
    suite = SensorSuite((PHASE(sigma=0.1, axis=0, platform=0), PHASE(sigma=0.1, axis=1, platform=0)))
    truth = np.concatenate([0.9 * pose.position, np.zeros((3, size))])
    turns = 2.0 * math.pi * 3.0 * 3e9 / 299_792_458.0
    look = FirstLook(StateLayout(3), truth, turns * cosines, suite, [pose], np.zeros((0, size)), ())
    mean, covariance = replace(PRIOR, platform=0).start(look)
    assert np.isfinite(mean).all()
    assert np.isfinite(covariance).all()
    # Nearest to the Earth's centre: square to the line, wherever that comes down at all.
    line = mean[:3] - pose.position
    comes_down = np.hypot(*cosines) < 0.99
    square = np.einsum("in,in->n", mean[:3], line) / EARTH_RADIUS**2
    np.testing.assert_allclose(square[comes_down], 0.0, atol=1e-9)
    assert (np.linalg.norm(mean[:3], axis=0) > EARTH_RADIUS).all()
    assert not linalg.unsound(covariance).any()
    assert (np.sqrt(linalg.diagonal(covariance)) < EARTH_RADIUS).all()


# In a scenario.

SCENARIO = Scenario(
    target=Target(start=GeodeticStart(latitude=PLACE[0], longitude=PLACE[1], height=10e3, speed=200.0)),
    platforms=SATELLITES,
    sensors=MISALIGNED,
    prior=PRIOR,
    tracker=ExtendedKalman(),
    episode=Episode(steps=20, decision_every=1, min_range=0.0),
)


def test_scenarios_begin_with_the_fix_of_the_satellite_named(begin: Callable[..., Simulation]) -> None:
    """Both satellites see the emitter; 500 fixes lie as far from it as their covariance says (false alarm 1e-3)."""
    simulation = begin(SCENARIO, 500)
    error = simulation.track.mean[:3] - simulation.truth[:3]
    # The height is exact here: what is left has two degrees of freedom, and less than the χ² of three.
    found = nees(error, simulation.track.covariance[:3, :3])
    assert stats.kstest(found, stats.chi2(2).cdf).pvalue > 1e-3
    assert SCENARIO.prior.carrier_platform(SCENARIO.sensors) == 1
    for _ in range(5):
        simulation.step(np.zeros((0, 500)))
    assert np.isfinite(simulation.track.mean).all()
    assert not simulation.track.repairs.any()


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    whole = first_look(MISALIGNED, 300, seed=3)
    names = ("position", "velocity", "acceleration", "attitude")

    def begin(truth: np.ndarray, measurement: np.ndarray, *values: np.ndarray) -> np.ndarray:
        poses = [Pose(*values[:4]), Pose(*values[4:])]
        look = replace(whole, truth=truth, measurement=measurement, poses=poses)
        mean, covariance = PRIOR.start(look)
        return np.concatenate([c.reshape(-1, c.shape[-1]) for c in (mean, covariance, PRIOR.at_truth(look))])

    values = [getattr(pose, name) for pose in whole.poses for name in names]
    assert_batch_free(begin, whole.truth, whole.measurement, *values)


def in_the_plane() -> Scenario:
    return Scenario().replace(prior=replace(PRIOR, platform=0))


def without(index: int) -> Scenario:
    return SCENARIO.replace(sensors=SCENARIO.sensors[:index] + SCENARIO.sensors[index + 1 :])


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (in_the_plane, "prior.platform"),
        (partial(without, 1), "prior.platform"),
        (partial(without, 3), "prior.platform"),
        (lambda: SCENARIO.replace(sensors=(*KNOWN, PHASE(sigma=0.1, axis=0))), "prior.platform"),
        (lambda: SCENARIO.replace(prior=replace(PRIOR, platform=0)), "prior.platform"),
        (lambda: SCENARIO.replace(prior=replace(PRIOR, platform=7)), "prior.platform"),
        (lambda: replace(PRIOR, height_sigma=0.0), "height_sigma"),
        (lambda: replace(PRIOR, velocity_sigma=-1.0), "velocity_sigma"),
        (lambda: replace(PRIOR, height=math.nan), "height"),
    ],
    ids=["plane", "no starboard", "no forward", "two forward", "one phase", "nobody", "height", "velocity", "nan"],
)
def test_what_is_impossible(build: Callable[[], object], field: str, refusal: Callable[..., ScenarioError]) -> None:
    assert refusal(build).field == field


def test_other_scenarios_in_space_are_none_of_its_business() -> None:
    """A station without interferometers starts from another prior."""
    still = (0.0, 0.0, 0.0)
    scenario = SCENARIO.replace(
        target=Target(start=CartesianStart(position=(30e3, 0.0, 0.0), velocity=still)),
        platforms=(FixedStation(position=still), FixedStation(position=(1e3, 0.0, 0.0))),
        sensors=(TimeDifference(sigma=1e-7),),
        prior=StatePrior(position_sigma=1.0, velocity_sigma=1.0),
    )
    assert scenario.dimension == 3
