"""Banks and interacting models against FilterPy, against a plain loop written out here, and against theory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy import stats

from passloc_env.angles import wrap
from passloc_env.dynamics import Dynamics
from passloc_env.fields import count, quantity, vector
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, Motion, UnknownTurn
from passloc_env.platforms import Pose
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.sensors import Bearing, Doppler, Sensor
from passloc_env.sightline import Scene
from passloc_env.tracking import InteractingModels, RangeBank, UnscentedKalman
from passloc_env.tracking.tracker import Models, Track, Tracker
from passloc_env.units import SPEED_OF_LIGHT

BEARING = Bearing(sigma=3e-3)
OFFSET = Doppler(sigma=10.0, carrier=3e9, carrier_sigma=1e4, carrier_walk=1.0)
STRAIGHT = ConstantVelocity(acceleration_noise=0.5)
PUSHED = ConstantAcceleration(acceleration_noise=0.1)
TURNING = UnknownTurn(acceleration_noise=0.5, turn_rate_noise=1e-3)
STEPS, PERIOD = 40, 1.0
SIGMAS = {"turn_rate": 0.02, "carrier_offset": 500.0}


def build(tracker: Tracker, sensors: tuple[Sensor, ...], size: int = 1) -> Track:
    """A running tracker of any motions, its models put together by hand."""
    suite = SensorSuite(sensors)

    def models(motion: Motion) -> Models:
        layout = motion.layout(2).with_nuisance(tuple(nuisance.name for nuisance in nuisances(sensors)))
        states = motion.nuisances + nuisances(sensors)
        return Models(
            layout, Dynamics(motion, layout, PERIOD, states), suite, tuple(models(member) for member in motion.members)
        )

    return tracker.build(models(tracker.motion), size)


def prior(track: Track) -> tuple[np.ndarray, np.ndarray]:
    """Mean ``(n,)`` and covariance ``(n, n)`` south of the origin, where bearings run through ±π."""
    layout = track.models.layout
    mean = np.zeros(layout.size)
    mean[:4] = -400.0, -30e3, 100.0, 10.0
    kinematic = [3e3, 5e3, 60.0, 50.0, 1.0, 1.5][: layout.kinematic.stop]
    covariance = np.diag(np.square([*kinematic, *(SIGMAS[name] for name in layout.nuisance)]))
    covariance[0, 1] = covariance[1, 0] = 3e6
    return mean, covariance


def begin(track: Track, size: int = 1) -> tuple[np.ndarray, np.ndarray]:
    mean, covariance = prior(track)
    track.start(np.arange(size), np.repeat(mean[:, None], size, axis=1), np.repeat(covariance[..., None], size, axis=2))
    return mean, covariance


def own_ship(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity on a circle of 4 km."""
    phase = 0.05 * time
    return 4e3 * np.array([np.cos(phase), np.sin(phase)]), 200.0 * np.array([-np.sin(phase), np.cos(phase)])


def heard(state: np.ndarray, own: tuple[np.ndarray, np.ndarray], offset: float | None) -> np.ndarray:
    """Bearing and, with an ``offset`` of the carrier, Doppler of one state."""
    (east, north), velocity = state[:2] - own[0], state[2:4] - own[1]
    bearing = np.arctan2(east, north)
    if offset is None:
        return np.array([bearing])
    rate = (east * velocity[0] + north * velocity[1]) / np.hypot(east, north)
    return np.array([bearing, offset - (3e9 + offset) * rate / SPEED_OF_LIGHT])


def measurements(sensors: tuple[Sensor, ...], seed: int = 0) -> list[np.ndarray]:
    """Of an emitter that turns at 1°/s from the twentieth step."""
    rng, state, course = np.random.default_rng(seed), np.array([-2e3, -27e3, 140.0, -20.0]), 0.0
    found = []
    for step in range(1, STEPS + 1):
        if step > 20:
            course = math.radians(1.0)
        east, north = state[2:]
        turned = [
            math.cos(course) * east + math.sin(course) * north,
            math.cos(course) * north - math.sin(course) * east,
        ]
        state[2:] = turned
        state[:2] += state[2:]
        true = heard(state, own_ship(step), 300.0 if OFFSET in sensors else None)
        found.append(true + rng.standard_normal(len(true)) * [3e-3, 10.0][: len(true)])
    return found


class PlainFilter:
    """One unscented filter of one environment in the textbook's own words (α = 1, β = 2, κ = 0)."""

    def __init__(self, motion: Motion, sensors: tuple[Sensor, ...], x: np.ndarray, P: np.ndarray) -> None:
        names = tuple(nuisance.name for nuisance in nuisances(sensors))
        self.layout = motion.layout(2).with_nuisance(names)
        self.dynamics = Dynamics(motion, self.layout, PERIOD, motion.nuisances + nuisances(sensors))
        self.doppler, self.R = OFFSET in sensors, np.diag(np.square([3e-3, 10.0][: len(sensors)]))
        self.x, self.P = x.copy(), P.copy()

    def points(self) -> np.ndarray:
        n = len(self.x)
        root = np.linalg.cholesky(n * self.P)
        return np.array([self.x, *(self.x + root.T), *(self.x - root.T)])

    def predict(self) -> None:
        moved = np.array([self.dynamics.mean(p[:, None], np.zeros(1))[:, 0] for p in self.points()])
        weight = 0.5 / len(self.x)
        self.x = moved[0] + weight * sum(p - moved[0] for p in moved[1:])
        # The centre's weight is 0 in the mean and 1 − α² + β = 2 in the covariance.
        outers = [np.outer(p - self.x, p - self.x) for p in moved]
        self.P = 2.0 * outers[0] + weight * sum(outers[1:]) + self.dynamics.process_noise[..., 0]

    def expect(self, z: np.ndarray, own: tuple[np.ndarray, np.ndarray]) -> None:
        """Innovation, its covariance and that with the state."""
        points, weight = self.points(), 0.5 / len(self.x)
        seen = np.array([heard(p, own, p[-1] if self.doppler else None) for p in points])
        seen[:, 0] = seen[0, 0] + wrap(seen[:, 0] - seen[0, 0])
        expected = weight * seen[1:].sum(axis=0)
        weights = np.array([2.0, *np.full(len(points) - 1, weight)])
        self.S = sum(w * np.outer(s - expected, s - expected) for w, s in zip(weights, seen, strict=True)) + self.R
        self.C = sum(w * np.outer(p - self.x, s - expected) for w, p, s in zip(weights, points, seen, strict=True))
        self.y = z - expected
        self.y[0] = wrap(self.y[0])

    def near(self, gate: float) -> np.ndarray:
        """Which scalars, each a sensor, lie within a gate of its own."""
        return self.y**2 <= stats.chi2.ppf(gate, 1) * np.diag(self.S)

    def correct(self, used: np.ndarray) -> float:
        """Correct by some scalars; the log-likelihood."""
        if not used.any():
            return 0.0
        y, S = self.y[used], self.S[np.ix_(used, used)]
        K = self.C[:, used] @ np.linalg.inv(S)
        self.x, self.P = self.x + K @ y, self.P - K @ S @ K.T
        return float(stats.multivariate_normal(cov=S).logpdf(y))


def mixed(weights: np.ndarray, beliefs: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    mean = sum(w * x for w, (x, _) in zip(weights, beliefs, strict=True))
    covariance = sum(w * (P + np.outer(x - mean, x - mean)) for w, (x, P) in zip(weights, beliefs, strict=True))
    return mean, covariance


def assert_close(track: Track, mean: np.ndarray, covariance: np.ndarray) -> None:
    """To 1e-7 of the standard deviations: two ways of writing sums whose terms are up to 1e3 times as large."""
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((track.mean[:, 0] - mean) / sigma, 0.0, atol=1e-7)
    np.testing.assert_allclose((track.covariance[..., 0] - covariance) / np.outer(sigma, sigma), 0.0, atol=1e-7)


def feed(track: Track, measurement: np.ndarray, step: int) -> None:
    """One step of a track of one environment."""
    position, velocity = own_ship(step)
    track.predict(np.array([step - 1.0]))
    track.update(measurement[:, None], [Pose(position[:, None], velocity[:, None], np.zeros((2, 1)))])


@pytest.mark.parametrize("motion", [STRAIGHT, TURNING], ids=["straight", "unknown turn"])
@pytest.mark.parametrize("sensors", [(BEARING,), (BEARING, OFFSET)], ids=["bearing", "and Doppler"])
def test_bank_is_the_plain_loop(motion: Motion, sensors: tuple[Sensor, ...]) -> None:
    """From the members that it starts with; how the prior is cut is tested by itself."""
    track = build(RangeBank(motion=motion), sensors)
    begin(track)
    parts = track.components
    filters = [
        PlainFilter(motion, sensors, parts["means"][:, i, 0], parts["covariances"][:, :, i, 0]) for i in range(5)
    ]
    cut = parts["weights"][:, 0].copy()
    weights = cut
    for step, z in enumerate(measurements(sensors), 1):
        for each in filters:
            each.predict()
            each.expect(z, own_ship(step))
        likelihood = np.exp([each.correct(np.ones(len(z), bool)) for each in filters])
        weights = weights * likelihood / (weights @ likelihood)
        feed(track, z, step)
        np.testing.assert_allclose(parts["weights"][:, 0], weights, atol=1e-9)
        assert_close(track, *mixed(weights, [(each.x, each.P) for each in filters]))
    # The measurements have told the members apart.
    assert np.abs(weights - cut).max() > 0.05


@pytest.mark.parametrize("gate", [0.0, 0.7], ids=["", "gated"])
@pytest.mark.parametrize("sensors", [(BEARING,), (BEARING, OFFSET)], ids=["bearing", "and Doppler"])
@pytest.mark.parametrize(
    "motions",
    [(STRAIGHT, PUSHED, TURNING), (TURNING, STRAIGHT), (PUSHED, STRAIGHT, ConstantVelocity(acceleration_noise=3.0))],
    ids=["three kinds", "turn first", "two alike"],
)
def test_models_of_different_states_are_the_plain_loop(
    motions: tuple[Motion, ...], sensors: tuple[Sensor, ...], gate: float
) -> None:
    """Mixing in the union of the states, where a missing one is the prior's spread around zero.

    Gated, all use what lies within the gate of any: chi-square quantiles are SciPy's.
    """
    sojourn, number = 30.0, len(motions)
    track = build(InteractingModels(motions=motions, sojourn=sojourn, gate=gate), sensors)
    x, P = begin(track)
    names = track.models.layout.names
    filters, rows = [], []
    for motion in motions:
        layout = motion.layout(2).with_nuisance(tuple(nuisance.name for nuisance in nuisances(sensors)))
        own = [names.index(name) for name in layout.names]
        filters.append(PlainFilter(motion, sensors, x[own], P[np.ix_(own, own)]))
        rows.append(own)

    def widened(which: int) -> tuple[np.ndarray, np.ndarray]:
        mean, covariance = np.zeros(len(x)), np.diag(np.diag(P))
        mean[rows[which]] = filters[which].x
        covariance[np.ix_(rows[which], rows[which])] = filters[which].P
        return mean, covariance

    stay = math.exp(-PERIOD / sojourn)
    transition = np.full((number, number), (1.0 - stay) / (number - 1))
    np.fill_diagonal(transition, stay)
    modes, refused, disputed = np.full(number, 1.0 / number), 0, 0
    for step, z in enumerate(measurements(sensors), 1):
        expected = modes @ transition
        starts = [
            mixed(transition[:, j] * modes / expected[j], list(map(widened, range(number)))) for j in range(number)
        ]
        for j, (mean, covariance) in enumerate(starts):
            filters[j].x, filters[j].P = mean[rows[j]], covariance[np.ix_(rows[j], rows[j])]
            filters[j].predict()
            filters[j].expect(z, own_ship(step))
        near = [each.near(gate) if gate else np.ones(len(z), bool) for each in filters]
        used = np.any(near, axis=0)
        refused += np.sum(~used)
        disputed += np.sum(used & ~np.all(near, axis=0))
        likelihood = np.exp([each.correct(used) for each in filters])
        modes = expected * likelihood / (expected @ likelihood)
        feed(track, z, step)
        np.testing.assert_allclose(track.components["modes"][:, 0], modes, atol=1e-7)
        assert_close(track, *mixed(modes, list(map(widened, range(number)))))
    assert track.gated[0] == refused
    assert (refused > 0) == (disputed > 0) == bool(gate)
    # The measurements have told the models apart, a little where bearings are all there is.
    assert modes.max() > 1.02 / number


@dataclass(frozen=True, kw_only=True)
class Position(Sensor):
    """Reads the position itself."""

    size = 2
    angular = (False, False)

    sigma: float = quantity("standard deviation per axis", unit="m", above=0)
    platform: int = count("index of the platform that carries it", 0)
    lever_arm: tuple[float, ...] = vector("where on the platform", (), unit="m")
    detection_probability: float = quantity("chance that a measurement is made", 1.0, above=0, at_most=1)

    def measure(self, scene: Scene) -> np.ndarray:
        return scene.state[scene.layout.position]

    def noise_covariance(self) -> np.ndarray:
        return self.sigma**2 * np.eye(2)[..., None]


def test_linear_models_are_filterpys() -> None:
    """Three turns seen through position sensors: FilterPy's IMM of Kalman filters, to 1e-9 of a standard deviation."""
    motions = tuple(CoordinatedTurn(turn_rate=rate, acceleration_noise=0.5) for rate in (-0.03, 0.0, 0.03))
    sojourn = 20.0
    track = build(InteractingModels(motions=motions, sojourn=sojourn), (Position(sigma=30.0),))
    x, P = begin(track)
    twins = []
    for models in track.models.members:
        twin = KalmanFilter(dim_x=4, dim_z=2)
        twin.x, twin.P, twin.H, twin.R = x.copy(), P.copy(), np.eye(2, 4), 900.0 * np.eye(2)
        twin.F, twin.Q = models.dynamics.transition.matrix[..., 0], models.dynamics.process_noise[..., 0]
        twins.append(twin)
    stay = math.exp(-PERIOD / sojourn)
    chances = np.full((3, 3), (1.0 - stay) / 2.0)
    np.fill_diagonal(chances, stay)
    estimator = IMMEstimator(twins, [1 / 3] * 3, chances)
    rng, state = np.random.default_rng(3), np.array([-1e3, -29e3, 150.0, 30.0])
    for step in range(1, STEPS + 1):
        motion = track.models.members[0 if step > 20 else 1].dynamics
        state = motion.mean(state[:, None], np.zeros(1))[:, 0]
        z = state[:2] + 30.0 * rng.standard_normal(2)
        estimator.predict()
        track.predict(np.array([step - 1.0]))
        track.update(z[:, None], [Pose(*np.zeros((3, 2, 1)))])
        estimator.update(z)
        sigma = np.sqrt(np.diag(estimator.P))
        np.testing.assert_allclose((track.mean[:, 0] - estimator.x) / sigma, 0.0, atol=1e-9)
        np.testing.assert_allclose((track.covariance[..., 0] - estimator.P) / np.outer(sigma, sigma), 0.0, atol=1e-9)
        np.testing.assert_allclose(track.weights[:, 0], estimator.mu, atol=1e-9)
    assert track.weights[0, 0] > 0.6


def test_models_of_one_state_are_filterpys() -> None:
    """FilterPy's IMM of unscented filters that hear bearings and Doppler, to 1e-8 of a standard deviation."""
    sensors, sojourn = (BEARING, OFFSET), 40.0
    motions = (STRAIGHT, ConstantVelocity(acceleration_noise=5.0))
    track = build(InteractingModels(motions=motions, sojourn=sojourn), sensors)
    x, P = begin(track)
    own = [own_ship(0)]

    def residual(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([wrap(a[0] - b[0]), a[1] - b[1]])

    def average(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return points[0] + sum(w * residual(p, points[0]) for w, p in zip(weights, points, strict=True))

    twins = []
    for models in track.models.members:
        twin = UnscentedKalmanFilter(
            5,
            2,
            PERIOD,
            lambda state: heard(state, own[0], state[-1]),
            lambda state, _, dynamics=models.dynamics: dynamics.mean(state[:, None], np.zeros(1))[:, 0],
            MerweScaledSigmaPoints(5, 1.0, 2.0, 0.0),
            z_mean_fn=average,
            residual_z=residual,
        )
        twin.x, twin.P, twin.Q = x.copy(), P.copy(), models.dynamics.process_noise[..., 0]
        twin.R = np.diag([9e-6, 100.0])
        twins.append(twin)
    stay = math.exp(-PERIOD / sojourn)
    estimator = IMMEstimator(twins, [0.5, 0.5], np.array([[stay, 1.0 - stay], [1.0 - stay, stay]]))
    for step, z in enumerate(measurements(sensors), 1):
        own[0] = own_ship(step)
        estimator.predict(PERIOD)
        estimator.update(z)
        feed(track, z, step)
        sigma = np.sqrt(np.diag(estimator.P))
        np.testing.assert_allclose((track.mean[:, 0] - estimator.x) / sigma, 0.0, atol=1e-8)
        np.testing.assert_allclose((track.covariance[..., 0] - estimator.P) / np.outer(sigma, sigma), 0.0, atol=1e-8)
        np.testing.assert_allclose(track.weights[:, 0], estimator.mu, atol=1e-8)


@pytest.mark.parametrize("motion", [STRAIGHT, TURNING, PUSHED], ids=["straight", "unknown turn", "acceleration"])
@pytest.mark.parametrize("kind", ["bank", "models"])
def test_one_member_is_the_plain_filter(kind: str, motion: Motion) -> None:
    """To the last bit, missed detections included."""
    tracker = RangeBank(motion=motion, members=1) if kind == "bank" else InteractingModels(motions=(motion,))
    sensors, size, rng = (BEARING, OFFSET), 3, np.random.default_rng(5)
    track, plain = build(tracker, sensors, size), build(UnscentedKalman(motion=motion), sensors, size)
    for each in (track, plain):
        begin(each, size)
    for step, z in enumerate(measurements(sensors), 1):
        pose = Pose(*(np.repeat(part[:, None], size, axis=1) for part in (*own_ship(step), np.zeros(2))))
        measured, detected = z[:, None] + 1e-3 * rng.standard_normal((2, size)), rng.random((2, size)) < 0.7
        for each in (track, plain):
            each.predict(np.full(size, step - 1.0))
            each.update(measured, [pose], detected)
        for name in ("mean", "covariance", "nis"):
            np.testing.assert_array_equal(getattr(track, name), getattr(plain, name))


def test_prediction_moves_the_mixture() -> None:
    """What is believed between prediction and update is the members' mixture, and mixing alone keeps its moments."""
    tracker = InteractingModels(motions=(ConstantVelocity(), ConstantVelocity()), sojourn=2.0)
    track = build(tracker, (BEARING,))
    begin(track)
    rng = np.random.default_rng(0)
    track.members.mean += rng.standard_normal(track.members.mean.shape) * 50.0
    track.weights[:, 0] = 0.8, 0.2
    track.combine()
    F = track.models.members[0].dynamics.transition.matrix[..., 0]
    mean, covariance = F @ track.mean[:, 0], F @ track.covariance[..., 0] @ F.T
    track.predict(np.zeros(1))
    np.testing.assert_allclose(track.mean[:, 0], mean, rtol=1e-12)
    np.testing.assert_allclose(track.covariance[..., 0], covariance, rtol=1e-9)
    # e^(−1/2) stay where they were.
    np.testing.assert_allclose(track.weights[0, 0], 0.2 + 0.6 * math.exp(-0.5), rtol=1e-12)
    np.testing.assert_allclose(track.weights.sum(axis=0), 1.0, rtol=1e-15)


def test_nothing_heard_tells_no_model_from_another() -> None:
    track = build(RangeBank(motion=STRAIGHT), (BEARING, OFFSET))
    begin(track)
    before = track.weights.copy()
    track.predict(np.zeros(1))
    pose = Pose(*(part[:, None] for part in (*own_ship(1), np.zeros(2))))
    track.update(np.full((2, 1), 1e9), [pose], np.zeros((2, 1), bool))
    np.testing.assert_allclose(track.weights, before, rtol=1e-14)
