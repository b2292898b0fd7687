"""The batched unscented filter against FilterPy's, against theory, and against its own sabotage."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy import stats

from passloc_env import linalg
from passloc_env.angles import wrap
from passloc_env.arrays import Array, Number
from passloc_env.dynamics import Dynamics
from passloc_env.fields import count, quantity, vector
from passloc_env.metrics import nees
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Motion, UnknownTurn
from passloc_env.platforms import Pose
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.sensors import Bearing, Doppler, Sensor
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.tracking import UnscentedKalman
from passloc_env.tracking.tracker import Models
from passloc_env.tracking.ukf import UnscentedTrack
from passloc_env.units import SPEED_OF_LIGHT

BEARING = Bearing(sigma=3e-3)
DOPPLER = Doppler(sigma=10.0, carrier=3e9)
OFFSET = Doppler(sigma=10.0, carrier=3e9, carrier_sigma=1e4, carrier_walk=1.0)
STRAIGHT = ConstantVelocity(acceleration_noise=0.5)
TURNING = UnknownTurn(acceleration_noise=0.5, turn_rate_noise=1e-3)


class Problem(NamedTuple):
    """What is tracked and how: enough to build our filter and FilterPy's."""

    motion: Motion
    sensors: tuple[Sensor, ...]

    @property
    def models(self) -> Models:
        states = self.motion.nuisances + nuisances(self.sensors)
        layout = self.motion.layout(2).with_nuisance(tuple(nuisance.name for nuisance in nuisances(self.sensors)))
        return Models(layout, Dynamics(self.motion, layout, 1.0, states), SensorSuite(self.sensors))

    def track(self, environments: int, filter_: UnscentedKalman | None = None) -> UnscentedTrack:
        """A track that starts from :meth:`prior` around :data:`START`."""
        track = (filter_ or UnscentedKalman(motion=self.motion)).build(self.models, environments)
        columns = np.arange(environments)
        track.start(columns, np.repeat(self.start[:, None], environments, axis=1), self.prior[..., None])
        return track

    @property
    def start(self) -> np.ndarray:
        return np.concatenate([START, np.zeros(self.models.layout.size - 4)])

    @property
    def prior(self) -> np.ndarray:
        layout = self.models.layout
        sigmas = {"turn_rate": 0.01, "carrier_offset": 500.0}
        return np.diag([3e3, 5e3, 60.0, 50.0, *(sigmas[name] for name in layout.nuisance)]) ** 2


START = np.array([-400.0, -30e3, 100.0, 10.0])
"""Due south and crossing it: bearings run through ±π."""


def own_ship(time: float, environments: int) -> Pose:
    """Circles of 4 km, differently placed in each environment, so that the range can be observed."""
    phase = 0.05 * time + np.linspace(0.0, 1.0, environments)
    position = 4e3 * np.stack([np.cos(phase), np.sin(phase)])
    velocity = 200.0 * np.stack([-np.sin(phase), np.cos(phase)])
    return Pose(position, velocity, 0.0 * position)


def measurements(problem: Problem, steps: int, environments: int, seed: int = 0) -> list[np.ndarray]:
    """Noisy measurements of an emitter that starts off the prior's mean and flies straight."""
    rng, models = np.random.default_rng(seed), problem.models
    truth = (problem.start + 0.5 * rng.normal(size=len(problem.start)) * np.sqrt(np.diag(problem.prior)))[:, None]
    truth[4:] = 0.0
    found = []
    for step in range(1, steps + 1):
        state = np.repeat(truth, environments, axis=1)
        state[:2] += step * state[2:4]
        noise = models.suite.noise(rng.standard_normal((models.suite.size, environments)))
        measured = models.suite.measure(Scene(state, models.layout, [own_ship(step, environments)])) + noise
        models.suite.wrap(measured)
        found.append(measured)
    return found


# Parity with FilterPy.


def filterpy_twin(problem: Problem, filter_: UnscentedKalman) -> UnscentedKalmanFilter:
    """FilterPy's filter of the same problem, its measurement written out by hand."""
    models, sensors = problem.models, problem.sensors
    angular = np.array([sensor is BEARING for sensor in sensors])

    def residual(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.where(angular, wrap(a - b), a - b)

    def mean(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return points[0] + weights @ residual(points, points[0])

    def measure(x: np.ndarray, own: np.ndarray) -> list[float]:
        east, north, *velocity = x[:4] - own
        rate = (east * velocity[0] + north * velocity[1]) / np.hypot(east, north)
        offset = x[-1] if OFFSET in sensors else 0.0
        shift = offset - (3e9 + offset) * rate / SPEED_OF_LIGHT
        return [np.arctan2(east, north) if sensor is BEARING else shift for sensor in sensors]

    def move(x: np.ndarray, _: float) -> np.ndarray:
        return models.dynamics.mean(x[:, None], np.zeros(1))[:, 0]

    n = models.layout.size
    points = MerweScaledSigmaPoints(n, filter_.alpha, filter_.beta, filter_.kappa)
    twin = UnscentedKalmanFilter(n, len(sensors), 1.0, measure, move, points, z_mean_fn=mean, residual_z=residual)
    twin.x, twin.P = problem.start, problem.prior
    twin.Q, twin.R = models.dynamics.process_noise[..., 0], models.suite.noise_covariance[..., 0]
    return twin


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 2.0, 0.0), (0.3, 2.0, 1.0), (1.0, 0.0, -1.0)])
@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(Problem(STRAIGHT, (BEARING,)), id="bearing"),
        pytest.param(Problem(STRAIGHT, (BEARING, DOPPLER)), id="bearing and Doppler"),
        pytest.param(Problem(STRAIGHT, (BEARING, OFFSET)), id="unknown carrier"),
        pytest.param(Problem(TURNING, (BEARING, DOPPLER)), id="unknown turn"),
    ],
)
def test_equal_to_filterpy(problem: Problem, alpha: float, beta: float, kappa: float) -> None:
    """Means, covariances and NIS agree to 1e-9 of their own standard deviations over 200 steps."""
    environments = 2
    filter_ = UnscentedKalman(motion=problem.motion, alpha=alpha, beta=beta, kappa=kappa)
    track = problem.track(environments, filter_)
    twins = [filterpy_twin(problem, filter_) for _ in range(environments)]
    for step, measured in enumerate(measurements(problem, 200, environments), start=1):
        pose = own_ship(step, environments)
        track.predict(np.full(environments, step - 1.0))
        track.update(measured, [pose])
        for column, twin in enumerate(twins):
            twin.predict()
            twin.update(measured[:, column], own=np.concatenate([pose.position, pose.velocity])[:, column])
            sigma = np.sqrt(np.diag(twin.P))
            np.testing.assert_allclose((track.mean[:, column] - twin.x) / sigma, 0.0, atol=1e-9)
            correlation = (track.covariance[..., column] - twin.P) / np.outer(sigma, sigma)
            np.testing.assert_allclose(correlation, 0.0, atol=1e-9)
            assert track.nis[column] == pytest.approx(twin.y @ twin.SI @ twin.y, rel=1e-7, abs=1e-9)
    assert not track.repairs.any()
    # Two filters that learn nothing agree as well.
    assert np.linalg.det(track.covariance[:2, :2, 0]) < 0.05 * np.linalg.det(problem.prior[:2, :2])


def test_half_a_turn_of_the_world_changes_nothing() -> None:
    """Sigma points come in pairs, so that turning everything by 180° must turn the belief alone, at any bearing."""
    problem = Problem(STRAIGHT, (BEARING,))
    track, turned = problem.track(1), problem.track(1)
    turned.mean *= -1.0
    for step, measured in enumerate(measurements(problem, 50, 1), start=1):
        pose = own_ship(step, 1)
        for each, sign, angle in ((track, 1.0, 0.0), (turned, -1.0, np.pi)):
            each.predict(np.full(1, step - 1.0))
            each.update(wrap(measured + angle), [Pose(sign * pose.position, sign * pose.velocity, pose.acceleration)])
    np.testing.assert_allclose(turned.mean, -track.mean, rtol=1e-9)
    np.testing.assert_allclose(turned.covariance, track.covariance, rtol=1e-6, atol=1e-9 * track.covariance.max())


# Missed detections.

BOTH = Problem(STRAIGHT, (BEARING, DOPPLER))


def test_missed_scalars_are_as_if_never_there() -> None:
    """Against a filter whose sensors are really taken away, step by step and environment by environment."""
    rng, environments = np.random.default_rng(1), 8
    track, reference = BOTH.track(environments), BOTH.track(environments)
    subsets = {
        made: Problem(STRAIGHT, tuple(itertools.compress(BOTH.sensors, made))).models
        for made in itertools.product([False, True], repeat=2)
        if any(made)
    }
    for step, measured in enumerate(measurements(BOTH, 60, environments), start=1):
        pose, detected = own_ship(step, environments), rng.random((2, environments)) < 0.6
        hidden = np.where(detected, measured, 1e9)
        for each in (track, reference):
            each.predict(np.full(environments, step - 1.0))
        track.update(hidden, [pose], detected)
        for made, models in subsets.items():
            columns = np.flatnonzero((detected == np.array(made)[:, None]).all(axis=0))
            alone = UnscentedTrack(UnscentedKalman(motion=STRAIGHT), models, len(columns))
            alone.start(np.arange(len(columns)), reference.mean[:, columns], reference.covariance[..., columns])
            seen = Pose(*(value[:, columns] for value in (pose.position, pose.velocity, pose.acceleration)))
            alone.update(measured[list(made)][:, columns], [seen])
            reference.mean[:, columns], reference.covariance[..., columns] = alone.mean, alone.covariance
    sigma = np.sqrt(linalg.diagonal(reference.covariance))
    # Two ways of writing the same sums, over 60 steps.
    np.testing.assert_allclose((track.mean - reference.mean) / sigma, 0.0, atol=1e-9)
    scaled = (track.covariance - reference.covariance) / (sigma[:, None] * sigma[None])
    np.testing.assert_allclose(scaled, 0.0, atol=1e-9)


@pytest.mark.parametrize("made", [True, False], ids=["everything", "nothing"])
def test_all_or_nothing_detected(made: bool) -> None:
    track, plain = BOTH.track(3), BOTH.track(3)
    (measured,) = measurements(BOTH, 1, 3)
    track.update(measured, [own_ship(1, 3)], np.full((2, 3), made))
    if made:
        plain.update(measured, [own_ship(1, 3)])
    for name in ("mean", "covariance", "nis"):
        np.testing.assert_array_equal(getattr(track, name), getattr(plain, name))


# Consistency: with a linear sensor the filter is the Kalman filter, and NEES and NIS are chi-square.


@dataclass(frozen=True, kw_only=True)
class Position(Sensor):
    """Reads the position itself."""

    size = 2
    angular = (False, False)

    sigma: Number = quantity("standard deviation per axis", unit="m", above=0)
    platform: int = count("index of the platform that carries it", 0)
    lever_arm: tuple[Number, ...] = vector("where on the platform", (), unit="m")
    detection_probability: Number = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)

    def measure(self, scene: Scene) -> Array:
        return scene.state[scene.layout.position]

    def jacobian(self, scene: Scene) -> Array:
        rows = scene.empty_jacobian(2)
        rows[0, 0] = rows[1, 1] = 1.0
        return rows

    def noise_covariance(self) -> Array:
        return self.sigma**2 * np.eye(2)[..., None]


RUNS, STEPS, SIGMA = 500, 40, 30.0


def assert_consistent(believed_sigma: float, believed_noise: float) -> None:
    """ANEES at the end (500 independent runs) and mean NIS (all steps) lie in their two-sided 95 % bands.

    Each band is missed by chance in 5 % of seeds, hence the fixed one. Half widths, and so the smallest effects that
    show: 6 % for ANEES, 1.4 % for NIS; a tenth less R moves the NIS by 4 %.
    """
    rng = np.random.default_rng(7)
    world = Problem(ConstantVelocity(acceleration_noise=2.0), (Position(sigma=SIGMA),))
    belief = Problem(ConstantVelocity(acceleration_noise=believed_noise), (Position(sigma=believed_sigma),))
    track, true = belief.track(RUNS), world.models
    truth = track.mean + np.sqrt(np.diag(belief.prior))[:, None] * rng.standard_normal((4, RUNS))
    total = 0.0
    for step in range(STEPS):
        truth = true.dynamics.mean(truth, np.zeros(RUNS))
        true.dynamics.disturb(truth, rng.standard_normal((true.dynamics.noise_size, RUNS)))
        measured = truth[:2] + true.suite.noise(rng.standard_normal((2, RUNS)))
        track.predict(np.full(RUNS, float(step)))
        track.update(measured, [own_ship(step, RUNS)])
        total += track.nis.sum()
    for statistic, degrees in ((nees(track.mean - truth, track.covariance).sum(), 4 * RUNS), (total, 2 * RUNS * STEPS)):
        low, high = stats.chi2.interval(0.95, degrees)
        assert low <= statistic <= high


def test_linear_control_is_consistent() -> None:
    assert_consistent(SIGMA, 2.0)


@pytest.mark.parametrize(
    ("sigma", "noise"),
    [(SIGMA / np.sqrt(2.0), 2.0), (SIGMA, 0.5), (1.05 * SIGMA, 2.0)],
    ids=["R halved", "Q too low", "R high"],
)
def test_sabotage_is_caught(sigma: float, noise: float) -> None:
    with pytest.raises(AssertionError):
        assert_consistent(sigma, noise)


# Health.

TRACKERS = {
    **SCENARIOS,
    "unknown turn": Scenario().override({"tracker.motion": TURNING}),
    "acceleration": Scenario().override({"tracker.motion": ConstantAcceleration(acceleration_noise=0.1)}),
}


@pytest.mark.parametrize("scenario", TRACKERS.values(), ids=list(TRACKERS))
def test_covariance_is_symmetric_to_the_last_bit_and_positive_definite(
    scenario: Scenario, begin: Callable[..., Simulation]
) -> None:
    simulation, rng = begin(scenario, 8), np.random.default_rng(2)
    for _ in range(20):
        simulation.step(rng.uniform(-1, 1, (1, 8)))
        covariance = simulation.track.covariance
        np.testing.assert_array_equal(covariance, covariance.swapaxes(0, 1))
        assert not linalg.unsound(covariance).any()


def test_an_indefinite_covariance_is_repaired_and_counted() -> None:
    track, control = BOTH.track(4), BOTH.track(4)
    track.covariance[0, 1, 2] = track.covariance[1, 0, 2] = 2.0 * 3e3 * 5e3
    (measured,) = measurements(BOTH, 1, 4)
    for each in (track, control):
        each.predict(np.zeros(4))
        each.update(measured, [own_ship(1, 4)])
    np.testing.assert_array_equal(track.repairs, [0, 0, 1, 0])
    np.testing.assert_array_equal(control.repairs, 0)
    assert not linalg.unsound(track.covariance).any()
    healthy = [0, 1, 3]
    np.testing.assert_array_equal(track.mean[:, healthy], control.mean[:, healthy])
    np.testing.assert_array_equal(track.covariance[..., healthy], control.covariance[..., healthy])
    assert np.isfinite(track.mean).all()


@pytest.mark.parametrize("field", ["mean", "covariance"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_track_that_went_non_finite_begins_anew(field: str, value: float, begin: Callable[..., Simulation]) -> None:
    """Nothing inside a step raises, the restart is counted, and the neighbours notice nothing."""
    simulation, control = begin(SCENARIOS["BearingDoppler"], 3), begin(SCENARIOS["BearingDoppler"], 3)

    def spoil(spoilt: Simulation) -> None:
        if spoilt.step_count[1] == 2:
            getattr(spoilt.track, field)[..., 1] = value

    simulation.watchers.append(spoil)
    for each in (simulation, control):
        each.step(np.zeros((1, 3)))
    np.testing.assert_array_equal(simulation.track.repairs, [0, 1, 0])
    assert np.isfinite(simulation.track.mean).all()
    assert not linalg.unsound(simulation.track.covariance).any()
    np.testing.assert_array_equal(simulation.track.mean[:, [0, 2]], control.track.mean[:, [0, 2]])


@pytest.mark.parametrize("motion", [STRAIGHT, TURNING], ids=["linear", "nonlinear"])
def test_bits_do_not_depend_on_the_batch(motion: Motion, assert_batch_free: Callable[..., None]) -> None:
    problem, rng = Problem(motion, (BEARING, OFFSET)), np.random.default_rng(3)
    n, size = problem.models.layout.size, 300
    means = problem.start[:, None] + np.sqrt(np.diag(problem.prior))[:, None] * rng.normal(size=(n, size))
    pose, detected = own_ship(0, size), (rng.random((2, size)) < 0.7).astype(float)
    measured = np.stack([rng.uniform(-3, 3, size), 100.0 * rng.normal(size=size)])

    def cycle(mean: np.ndarray, *rest: np.ndarray) -> np.ndarray:
        position, velocity, measured, detected = rest
        track = problem.track(mean.shape[-1])
        track.mean[...] = mean
        for step in range(2):
            track.predict(np.full(mean.shape[-1], float(step)))
            track.update(measured, [Pose(position, velocity, 0.0 * velocity)], detected > 0.5)
        return np.concatenate([track.mean, track.covariance.reshape(n * n, -1), track.nis[None]])

    assert_batch_free(cycle, means, pose.position, pose.velocity, measured, detected)
