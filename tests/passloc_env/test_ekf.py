"""The batched extended filter against FilterPy's, against the linear Kalman filter, and against its own misuse."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter

from passloc_env import linalg
from passloc_env.angles import wrap
from passloc_env.arrays import Array, Number
from passloc_env.dynamics import Dynamics
from passloc_env.errors import ScenarioError
from passloc_env.fields import count, quantity, vector
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, Motion, UnknownTurn
from passloc_env.platforms import CircularOrbit, Pose, TurnLimitedPlatform
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, Doppler, PhaseDifference, RadialAcceleration, Sensor, TimeDifference
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.tracking import ExtendedKalman
from passloc_env.tracking.ekf import ExtendedTrack
from passloc_env.tracking.tracker import Models
from passloc_env.units import SPEED_OF_LIGHT

STEPS, ENVIRONMENTS, PERIOD = 200, 3, 1.0


class Problem(NamedTuple):
    """What is tracked and how, and what FilterPy needs to be told of it.

    ``written_out`` gives measurement and Jacobian of one state, from the poses of one environment, by hand.
    """

    motion: Motion
    sensors: tuple[Sensor, ...]
    observers: Callable[[float, int], list[Pose]]
    written_out: Callable[[np.ndarray, list[Pose]], tuple[np.ndarray, np.ndarray]]
    start: np.ndarray
    sigmas: tuple[float, ...]

    @property
    def models(self) -> Models:
        layout = self.motion.layout(len(self.observers(0.0, 1)[0].position))
        return Models(layout, Dynamics(self.motion, layout, PERIOD), SensorSuite(self.sensors))

    def track(self, environments: int = ENVIRONMENTS) -> ExtendedTrack:
        track = ExtendedKalman(motion=self.motion).build(self.models, environments)
        mean = np.repeat(self.start[:, None], environments, axis=1)
        track.start(np.arange(environments), mean, np.diag(np.square(self.sigmas))[..., None])
        return track

    def measurements(self, seed: int = 0) -> list[tuple[list[Pose], np.ndarray, np.ndarray]]:
        """Poses, noisy measurements and what is detected of an emitter that starts off the prior's mean."""
        rng, models = np.random.default_rng(seed), self.models
        noise = models.dynamics.noise_size
        truth = self.start[:, None] + np.array(self.sigmas)[:, None] * rng.normal(size=(len(self.start), ENVIRONMENTS))
        made = []
        for step in range(1, STEPS + 1):
            truth = models.dynamics.mean(truth, np.zeros(ENVIRONMENTS))
            models.dynamics.disturb(truth, rng.standard_normal((noise, ENVIRONMENTS)))
            poses = self.observers(step * PERIOD, ENVIRONMENTS)
            measured = models.suite.measure(Scene(truth, models.layout, poses))
            measured += models.suite.noise(rng.standard_normal(measured.shape))
            models.suite.wrap(measured)
            made.append((poses, measured, rng.random(measured.shape) < 0.7))
        return made


def vessels(time: float, environments: int) -> list[Pose]:
    """Aircraft in circles of 4.4 km, differently placed in each environment."""
    aircraft = TurnLimitedPlatform(speed=220.0, max_turn_rate=0.05, control="turn_rate")
    state = aircraft.start(environments)
    state[2] = np.linspace(0.0, 1.0, environments)
    state[4:] = [np.sin(state[2]), np.cos(state[2])]
    return [aircraft.pose(aircraft.move(state, np.full((1, environments), 0.05), time))]


def satellites(time: float, environments: int) -> list[Pose]:
    """Two on crossing orbits, so that times and phases tell different things."""
    orbits = (
        CircularOrbit(inclination=1.0, node_longitude=-0.1, argument_of_latitude=0.45),
        CircularOrbit(inclination=1.4, node_longitude=0.2, argument_of_latitude=0.5),
    )
    rest = np.zeros((3, environments))
    return [orbit.pose(orbit.move(orbit.start(environments), rest, time)) for orbit in orbits]


def derivative(function: Callable[[np.ndarray], Any], state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A function's values and its Jacobian by complex steps, which are exact to rounding."""
    steps = state[:, None] + 1e-20j * np.eye(len(state))
    return np.array(function(state), float), np.stack([np.imag(function(step)) for step in steps.T], axis=-1) / 1e-20


def bearing_and_doppler(x: np.ndarray, poses: list[Pose]) -> tuple[np.ndarray, np.ndarray]:
    own = np.concatenate([poses[0].position[:, 0], poses[0].velocity[:, 0]])

    def shift(x: np.ndarray) -> list[Any]:
        east, north, *velocity = x - own
        return [-3e9 / SPEED_OF_LIGHT * (east * velocity[0] + north * velocity[1]) / (east**2 + north**2) ** 0.5]

    value, slope = derivative(shift, x)
    east, north = (x - own)[:2]
    turn = np.array([north, -east, 0.0, 0.0]) / (east**2 + north**2)
    return np.array([np.arctan2(east, north), *value]), np.stack([turn, slope[0]])


def phases_and_times(x: np.ndarray, poses: list[Pose]) -> tuple[np.ndarray, np.ndarray]:
    def heard(x: np.ndarray) -> list[Any]:
        offsets = [x[:3] - pose.position[:, 0] for pose in poses]
        ranges = [(offset @ offset) ** 0.5 for offset in offsets]
        turns = 2.0 * np.pi * 1.5 * 1e9 / SPEED_OF_LIGHT
        phases = [
            turns * (axis @ offset) / away
            for pose, offset, away in zip(poses, offsets, ranges, strict=True)
            for axis in pose.attitude[:2, :, 0]
        ]
        return [*phases, (ranges[1] - ranges[0]) / SPEED_OF_LIGHT]

    return derivative(heard, x)


def bearing_and_acceleration(x: np.ndarray, poses: list[Pose]) -> tuple[np.ndarray, np.ndarray]:
    pose = poses[0]
    own = np.concatenate([pose.position[:, 0], pose.velocity[:, 0], pose.acceleration[:, 0]])

    def second(x: np.ndarray) -> list[Any]:
        p, v, a = (x - own).reshape(3, 2)
        away = (p @ p) ** 0.5
        return [(v @ v + p @ a) / away - (p @ v) ** 2 / away**3]

    value, slope = derivative(second, x)
    east, north = (x - own)[:2]
    turn = np.array([north, -east, 0.0, 0.0, 0.0, 0.0]) / (east**2 + north**2)
    return np.array([np.arctan2(east, north), *value]), np.stack([turn, slope[0]])


PHASE = partial(PhaseDifference, sigma=0.05, baseline=1.5, carrier=1e9)
ON_GROUND = satellites(100.0, 1)[0].position[:, 0] * (6.38e6 / 7.08e6) + np.array([2e5, -3e5, 1e5])

PROBLEMS = {
    "bearing and Doppler": Problem(
        ConstantVelocity(acceleration_noise=0.5),
        (Bearing(sigma=3e-3), Doppler(sigma=10.0, carrier=3e9)),
        vessels,
        bearing_and_doppler,
        # Due south and crossing it: bearings run through ±π.
        np.array([-400.0, -30e3, 40.0, 10.0]),
        (3e3, 5e3, 60.0, 50.0),
    ),
    "phases and time difference": Problem(
        ConstantVelocity(acceleration_density=0.1),
        (*(PHASE(platform=p, axis=axis) for p in (0, 1) for axis in (0, 1)), TimeDifference(sigma=1e-7)),
        satellites,
        phases_and_times,
        np.array([*ON_GROUND, 100.0, 50.0, -30.0]),
        (2e4, 2e4, 2e4, 100.0, 100.0, 100.0),
    ),
    "radial acceleration": Problem(
        ConstantAcceleration(acceleration_noise=0.01),
        (Bearing(sigma=1e-3), RadialAcceleration(sigma=0.02)),
        vessels,
        bearing_and_acceleration,
        np.array([20e3, 35e3, -150.0, 60.0, 0.3, -0.2]),
        (4e3, 4e3, 50.0, 50.0, 0.3, 0.3),
    ),
}


@pytest.fixture(params=PROBLEMS.values(), ids=list(PROBLEMS))
def problem(request: pytest.FixtureRequest) -> Problem:
    found: Problem = request.param
    return found


def poses_of(poses: list[Pose], column: int) -> list[Pose]:
    """The poses of one environment alone."""
    names = ("position", "velocity", "acceleration", "attitude", "attitude_rate")
    return [Pose(*(getattr(pose, name)[..., [column]] for name in names)) for pose in poses]


def filterpy_twin(problem: Problem) -> ExtendedKalmanFilter:
    models = problem.models
    n = models.layout.size
    twin = ExtendedKalmanFilter(n, models.suite.size)
    twin.x, twin.P = problem.start.copy(), np.diag(np.square(problem.sigmas))
    twin.F = models.dynamics.motion.transition(models.layout, PERIOD)[..., 0]
    twin.Q = models.dynamics.process_noise[..., 0]
    return twin


def update_twin(
    twin: ExtendedKalmanFilter, problem: Problem, z: np.ndarray, poses: list[Pose], made: np.ndarray
) -> None:
    """Give FilterPy the detected rows alone, in units of their noise, so that it inverts well-scaled matrices."""
    if not made.any():
        return
    sigma = np.array([float(sensor.sigma) for sensor in problem.sensors])[made]  # type: ignore[attr-defined]
    angular = np.array([sensor.angular[0] for sensor in problem.sensors])[made]

    def residual(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.where(angular, wrap((a - b) * sigma) / sigma, a - b)

    twin.update(
        z[made] / sigma,
        lambda x: problem.written_out(x, poses)[1][made] / sigma[:, None],
        lambda x: problem.written_out(x, poses)[0][made] / sigma,
        R=np.eye(len(sigma)),
        residual=residual,
    )


@pytest.mark.parametrize("misses", [False, True], ids=["all detected", "some undetected"])
def test_equal_to_filterpy(problem: Problem, misses: bool) -> None:
    """Means and covariances agree to 1e-9 of their own standard deviations over 200 steps.

    Undetected rows are taken out of FilterPy's measurement. Measurements and Jacobians are written out here.
    """
    track, twins = problem.track(), [filterpy_twin(problem) for _ in range(ENVIRONMENTS)]
    assert isinstance(track, ExtendedTrack)
    for step, (poses, measured, detected) in enumerate(problem.measurements()):
        made = detected if misses else np.ones_like(detected)
        track.predict(np.full(ENVIRONMENTS, step * PERIOD))
        track.update(np.where(made, measured, 1e9), poses, made if misses else None)
        for column, twin in enumerate(twins):
            twin.predict()
            update_twin(twin, problem, measured[:, column], poses_of(poses, column), made[:, column])
            sigma = np.sqrt(np.diag(twin.P))
            np.testing.assert_allclose((track.mean[:, column] - twin.x) / sigma, 0.0, atol=1e-9)
            correlation = (track.covariance[..., column] - twin.P) / np.outer(sigma, sigma)
            np.testing.assert_allclose(correlation, 0.0, atol=1e-9)
            if made[:, column].any():
                assert track.nis[column] == pytest.approx(twin.y @ twin.SI @ twin.y, rel=1e-7, abs=1e-9)
            else:
                assert track.nis[column] == 0.0
    assert not track.repairs.any()
    # Two filters that learn nothing agree as well.
    d = len(poses[0].position)
    learnt = np.linalg.det(track.covariance[:d, :d, 0]) / np.prod(np.square(problem.sigmas[:d]))
    assert learnt < 0.05


def test_bits_do_not_depend_on_the_batch(problem: Problem, assert_batch_free: Callable[..., None]) -> None:
    size = 100
    rng, models = np.random.default_rng(1), problem.models
    poses = problem.observers(7.0, size)
    n, names = models.layout.size, ("position", "velocity", "acceleration", "attitude", "attitude_rate")
    mean = problem.start[:, None] + 0.3 * np.array(problem.sigmas)[:, None] * rng.normal(size=(n, size))
    covariance = np.diag(np.square(problem.sigmas))[..., None] * rng.uniform(0.5, 1.0, size)
    measured = models.suite.measure(Scene(mean, models.layout, poses)) + models.suite.noise(
        rng.normal(size=(models.suite.size, size))
    )
    detected = rng.random(measured.shape) < 0.8

    def run(mean: np.ndarray, covariance: np.ndarray, measured: np.ndarray, made: np.ndarray, *pose: Any) -> np.ndarray:
        track = ExtendedTrack(ExtendedKalman(), models, mean.shape[1])
        track.start(np.arange(mean.shape[1]), mean, covariance)
        seen = [Pose(*pose[first : first + len(names)]) for first in range(0, len(pose), len(names))]
        track.predict(np.zeros(mean.shape[1]))
        track.update(measured, seen, made)
        return np.concatenate([track.mean, track.covariance.reshape(n * n, -1), track.nis[None]])

    values = [getattr(pose, name) for pose in poses for name in names]
    assert_batch_free(run, mean, covariance, measured, detected, *values)


# With a linear sensor the filter is the Kalman filter.


@dataclass(frozen=True, kw_only=True)
class Coordinates(Sensor):
    """Reads the position itself, in two numbers."""

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


@pytest.mark.parametrize(
    "motion",
    [
        ConstantVelocity(acceleration_noise=2.0, known_acceleration=(0.3, -0.2)),
        CoordinatedTurn(turn_rate=0.1, acceleration_noise=1.0),
        ConstantAcceleration(acceleration_noise=0.1),
    ],
    ids=["straight", "turn", "acceleration"],
)
def test_linear_problems_are_solved_by_the_kalman_filter(motion: Motion) -> None:
    n, rng = 2 * (motion.order + 1), np.random.default_rng(2)
    problem = PROBLEMS["bearing and Doppler"]._replace(motion=motion, sensors=(Coordinates(sigma=30.0),))
    problem = problem._replace(start=np.arange(1.0, n + 1.0), sigmas=(300.0, 200.0, 20.0, 30.0, 1.0, 2.0)[:n])
    track, models = problem.track(1), problem.models
    twin = KalmanFilter(n, 2)
    twin.x, twin.P = problem.start[:, None].copy(), np.diag(np.square(problem.sigmas))
    twin.F, twin.Q = motion.transition(models.layout, PERIOD)[..., 0], models.dynamics.process_noise[..., 0]
    twin.H, twin.R = np.eye(2, n), 900.0 * np.eye(2)
    push = motion.known_input(models.layout, PERIOD)
    twin.B = np.zeros((n, 1)) if push is None else push
    for step in range(STEPS):
        measured = 100.0 * rng.normal(size=(2, 1))
        track.predict(np.full(1, float(step)))
        track.update(measured, vessels(0.0, 1))
        twin.predict(u=np.ones((1, 1)))
        twin.update(measured)
        sigma = np.sqrt(np.diag(twin.P))
        np.testing.assert_allclose((track.mean - twin.x) / sigma[:, None], 0.0, atol=1e-9)
        np.testing.assert_allclose((track.covariance[..., 0] - twin.P) / np.outer(sigma, sigma), 0.0, atol=1e-9)


# Health.


@pytest.mark.parametrize("name", ["BearingsOnly", "BearingDopplerUnknownCarrier", "OwnShipSevere"])
def test_covariance_is_symmetric_to_the_last_bit_and_positive_definite(
    name: str, begin: Callable[..., Simulation]
) -> None:
    scenario = SCENARIOS[name]
    simulation = begin(scenario.replace(tracker=ExtendedKalman(motion=scenario.tracker.motion)), 8)
    rng = np.random.default_rng(2)
    for _ in range(20):
        simulation.step(rng.uniform(-1, 1, (1, 8)))
        covariance = simulation.track.covariance
        np.testing.assert_array_equal(covariance, covariance.swapaxes(0, 1))
        assert not linalg.unsound(covariance).any()
        assert np.isfinite(simulation.track.mean).all()


def test_an_indefinite_covariance_is_repaired_and_counted() -> None:
    problem = PROBLEMS["bearing and Doppler"]
    track, control = problem.track(), problem.track()
    track.covariance[0, 1, 2] = track.covariance[1, 0, 2] = 2.0 * 3e3 * 5e3
    poses, measured, _ = problem.measurements()[0]
    for each in (track, control):
        each.predict(np.zeros(ENVIRONMENTS))
        each.update(measured, poses)
    np.testing.assert_array_equal(track.repairs, [0, 0, 1])
    np.testing.assert_array_equal(control.repairs, 0)
    assert not linalg.unsound(track.covariance).any()
    np.testing.assert_array_equal(track.mean[:, :2], control.mean[:, :2])
    np.testing.assert_array_equal(track.covariance[..., :2], control.covariance[..., :2])


def test_nonlinear_motions_are_refused(refusal: Callable[..., ScenarioError]) -> None:
    error = refusal(lambda: ExtendedKalman(motion=UnknownTurn()))
    assert (error.field, error.value) == ("motion", "UnknownTurn")
    assert "UnscentedKalman" in error.allowed
    scenario = SCENARIOS["BearingsOnly"].replace(tracker=ExtendedKalman())
    assert refusal(scenario.override, {"tracker.motion": UnknownTurn()}).field == "tracker.motion"
    assert replace(ExtendedKalman(), motion=CoordinatedTurn(turn_rate=0.1)).motion.linear
