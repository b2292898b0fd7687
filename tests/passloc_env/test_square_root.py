"""The square-root filter: the unscented filter's belief, kept where the unscented filter loses it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import mpmath
import numpy as np
import pytest
from filterpy.kalman import SquareRootKalmanFilter

from passloc_env import LocalisationEnv
from passloc_env.arrays import Array, Number
from passloc_env.distributions import LogUniform
from passloc_env.errors import ScenarioError
from passloc_env.fields import count, quantity, vector
from passloc_env.linalg import diagonal, unsound
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Motion, UnknownTurn
from passloc_env.platforms import FixedStation, Pose
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensors import Sensor
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import SquareRootKalman, StatePrior, UnscentedKalman

PLANAR = [name for name, scenario in SCENARIOS.items() if scenario.dimension == 2]
TURNING = UnknownTurn(acceleration_noise=0.5, turn_rate_noise=1e-3)


def with_tracker(scenario: Scenario, kind: type = SquareRootKalman, **fields: Any) -> Scenario:
    """The scenario with a filter of ours inside, believing the same motion."""
    return scenario.replace(tracker=kind(**{"motion": scenario.tracker.motion, **fields}))


def assert_one_belief(found: Any, expected: Any, tolerance: float) -> None:
    """Two tracks agree, in units of their own standard deviations, and in their NIS."""
    sigma = np.sqrt(diagonal(expected.covariance))
    np.testing.assert_allclose((found.mean - expected.mean) / sigma, 0.0, atol=tolerance)
    correlation = (found.covariance - expected.covariance) / (sigma[:, None] * sigma[None])
    np.testing.assert_allclose(correlation, 0.0, atol=tolerance)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=tolerance, atol=tolerance)


def fly_both(
    begin: Callable[..., Simulation], scenario: Scenario, decisions: int, tolerance: float = 1e-9, **fields: Any
) -> list[Simulation]:
    """Both filters through the same episodes of two environments, compared after every decision."""
    rng = np.random.default_rng(1)
    pair = [begin(with_tracker(scenario, kind, **fields), 2) for kind in (SquareRootKalman, UnscentedKalman)]
    for _ in range(decisions):
        action = rng.uniform(-1.0, 1.0, (scenario.action_size, 2))
        for simulation in pair:
            simulation.step(action)
        assert_one_belief(pair[0].track, pair[1].track, tolerance)
    assert not pair[0].track.repairs.any()
    assert not pair[1].track.repairs.any()
    return pair


# Parity with the plain filter. 1e-9: roundings of about 1e-13 grow along the range before the first turn.


@pytest.mark.parametrize("name", PLANAR)
def test_equal_to_the_unscented_filter_through_whole_episodes(name: str, begin: Callable[..., Simulation]) -> None:
    scenario = SCENARIOS[name]
    root, _ = fly_both(begin, scenario, scenario.episode.steps // scenario.episode.decision_every)
    assert root.truncated.all()


@pytest.mark.parametrize(
    ("alpha", "beta", "kappa"),
    [(0.3, 2.0, 1.0), (0.01, 2.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.5, -1.0), (1.0, 0.0, -1.0), (1.2, -0.5, -1.5)],
)
@pytest.mark.parametrize(
    "motion", [ConstantVelocity(acceleration_noise=0.5), TURNING], ids=["linear motion", "nonlinear motion"]
)
def test_equal_for_every_weight_of_the_centre(
    motion: Motion, alpha: float, beta: float, kappa: float, begin: Callable[..., Simulation]
) -> None:
    """Weights of the centre from far below zero to above it; the last two are below what needs no downdate.

    Sigma points that lie closer together by α know their slopes less well by 1/α.
    """
    scenario = SCENARIOS["BearingDopplerUnknownCarrier"]
    root, _ = fly_both(begin, scenario, 20, 1e-9 / min(alpha, 1.0), motion=motion, alpha=alpha, beta=beta, kappa=kappa)
    states = root.models.tracker.layout.size
    assert bool(root.track._excess) == (beta < -(alpha**2) * kappa / states)


def test_random_noise_reaches_every_environment(begin: Callable[..., Simulation]) -> None:
    changes = {"sensors.0.sigma": LogUniform(low=1e-3, high=3e-2), "tracker.motion.acceleration_noise": 0.3}
    root, _ = fly_both(begin, SCENARIOS["BearingDoppler"].override(changes), 20)
    sigmas = np.sqrt(root.models.suite.noise_covariance[0, 0])
    assert sigmas[0] != sigmas[1]


def test_missed_detections(begin: Callable[..., Simulation]) -> None:
    changes = {"sensors.0.detection_probability": 0.5, "sensors.1.detection_probability": 0.7}
    root, _ = fly_both(begin, SCENARIOS["BearingDoppler"].override(changes), 40)
    assert root.detected is not None


# A linear sensor: then the filter is the Kalman filter, and everything is known in closed form.


@dataclass(frozen=True, kw_only=True)
class Position(Sensor):
    """Reads the position itself, its axes correlated."""

    size = 2
    angular = (False, False)

    sigma: Number = quantity("standard deviation per axis", unit="m", above=0)
    correlation: float = quantity("correlation of the axes", 0.0, plain=True)
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
        return self.sigma**2 * np.array([[1.0, self.correlation], [self.correlation, 1.0]])[..., None]


POSITION = Scenario(
    target=Target(start=CartesianStart(position=(30e3, 40e3), velocity=(10.0, -5.0))),
    platforms=(FixedStation(position=(0.0, 0.0)),),
    sensors=(Position(sigma=30.0, correlation=0.8),),
    prior=StatePrior(position_sigma=1e3, velocity_sigma=30.0),
    tracker=SquareRootKalman(motion=ConstantVelocity(acceleration_noise=0.5)),
)


def watched(simulation: Simulation, look: Callable[[Array, list[Pose]], None]) -> None:
    """Tell ``look`` every measurement and pose before the tracker has them."""
    simulation.straight = False
    update = simulation.track.update

    def tell(measurement: Array, poses: list[Pose], detected: Any = None) -> None:
        look(measurement, poses)
        update(measurement, poses, detected)

    simulation.track.update = tell  # type: ignore[method-assign]


def test_equal_to_filterpys_square_root_filter(begin: Callable[..., Simulation]) -> None:
    """Mean and root (its columns' signs aside) to 1e-10 of the standard deviations over 200 steps."""
    simulation = begin(POSITION)
    track, models = simulation.track, simulation.models.tracker
    twin = SquareRootKalmanFilter(4, 2)
    twin.x, twin.P, twin.F, twin.H = track.mean.copy(), track.covariance[..., 0], np.eye(4), np.eye(2, 4)
    twin.F[:2, 2:] = np.eye(2)
    twin.R = models.suite.noise_covariance[..., 0]
    # Its setter of Q asks for a definite matrix, which noise on the accelerations alone is not.
    twin._Q1_2 = models.dynamics.noise_gain[..., 0]

    def follow(measurement: Array, _: list[Pose]) -> None:
        twin.predict()
        twin.update(measurement.copy())

    watched(simulation, follow)
    while not simulation.truncated.all():
        simulation.step(np.zeros((0, 1)))
        sigma = np.sqrt(diagonal(track.covariance))
        np.testing.assert_allclose((track.mean - twin.x) / sigma, 0.0, atol=1e-10)
        theirs = twin.P1_2 * np.copysign(1.0, np.diag(twin.P1_2))
        np.testing.assert_allclose((track.root[..., 0] - theirs) / sigma, 0.0, atol=1e-10)
    assert simulation.step_count[0] >= 200


@pytest.mark.parametrize("made", [(True, False), (False, True), (False, False)])
def test_one_of_two_correlated_scalars_missed(made: tuple[bool, bool], begin: Callable[..., Simulation]) -> None:
    """The scalar that was made counts as if it were the only one: ``P − P hᵀ h P / (h P hᵀ + r)`` on its own axis."""
    simulation = begin(POSITION)
    simulation.step(np.zeros((0, 1)))
    track = simulation.track
    mean, covariance = track.mean[:, 0].copy(), track.covariance[..., 0].copy()
    measured = mean[:2, None] + np.array([[20.0], [-10.0]])
    hidden = np.where(np.array(made)[:, None], measured, np.nan)
    track.update(hidden, simulation.poses(), np.array(made)[:, None])
    for axis in np.flatnonzero(made):
        gain = covariance[axis] / (covariance[axis, axis] + 30.0**2)
        mean = mean + gain * (measured[axis, 0] - mean[axis])
        covariance = covariance - np.outer(gain, covariance[axis])
    np.testing.assert_allclose(track.mean[:, 0], mean, rtol=1e-12)
    np.testing.assert_allclose(track.covariance[..., 0], covariance, rtol=1e-10)


@pytest.mark.parametrize("made", [True, False], ids=["everything", "nothing"])
def test_all_or_nothing_detected(made: bool, begin: Callable[..., Simulation]) -> None:
    """Bit for bit: an environment must not notice that its neighbours missed something."""
    track, plain = (begin(with_tracker(SCENARIOS["BearingDoppler"]), 3).track for _ in range(2))
    pose = Pose(*np.random.default_rng(0).normal(size=(3, 2, 3)))
    measured = np.array([[3.0] * 3, [100.0] * 3])
    track.update(measured, [pose], np.full((2, 3), made))
    if made:
        plain.update(measured, [pose])
    for name, values in plain.state_arrays().items():
        np.testing.assert_array_equal(track.state_arrays()[name], values)


# Where the plain filter fails: noise far below the prior, against fifty decimal digits.


class FiftyDigits:
    """The unscented filter for one environment as the textbook writes it, in fifty digits.

    Weighted sums about the weighted mean over all 2n + 1 points (Wan & van der Merwe 2000), linear motion.
    """

    def __init__(self, simulation: Simulation, measure: Callable[[Any, Pose], list[Any]], angular: bool) -> None:
        self._tracker, self._measure, self._angular = simulation.scenario.tracker, measure, angular
        models = simulation.models.tracker
        self.x, self.P = exact(simulation.track.mean), exact(simulation.track.covariance[..., 0])
        gain = exact(models.dynamics.noise_gain[..., 0])
        self._F, self._Q = exact(models.dynamics.transition.matrix[..., 0]), gain * gain.T
        self._R = exact(models.suite.noise_covariance[..., 0])
        self.nis = mpmath.mpf(0)

    def step(self, measurement: Array, poses: list[Pose]) -> None:
        alpha, beta, kappa = (mpmath.mpf(getattr(self._tracker, name)) for name in ("alpha", "beta", "kappa"))
        n = len(self.x)
        self.x, self.P = self._F * self.x, self._F * self.P * self._F.T + self._Q
        spread = alpha**2 * (n + kappa)
        offsets = mpmath.sqrt(spread) * mpmath.cholesky(self.P)
        columns = [offsets[:, i] for i in range(n)]
        points = [self.x, *(self.x + o for o in columns), *(self.x - o for o in columns)]
        weights = [1 - n / spread] + 2 * n * [1 / (2 * spread)]
        centre = [weights[0] + 1 - alpha**2 + beta, *weights[1:]]
        found = [self._measured(point, poses) for point in points]
        found = [found[0] + self._wrapped(z - found[0]) for z in found]
        mean = sum((w * z for w, z in zip(weights, found, strict=True)), 0 * found[0])
        S, C = self._R.copy(), mpmath.zeros(n, len(mean))
        for w, point, z in zip(centre, points, found, strict=True):
            S += w * (z - mean) * (z - mean).T
            C += w * (point - self.x) * (z - mean).T
        precision = S**-1
        y = self._wrapped(exact(measurement) - mean)
        self.x, self.P = self.x + C * precision * y, self.P - C * precision * C.T
        self.nis = (y.T * precision * y)[0]

    def _measured(self, point: Any, poses: list[Pose]) -> Any:
        return mpmath.matrix(self._measure(point, poses[0]))

    def _wrapped(self, gap: Any) -> Any:
        if not self._angular:
            return gap
        return mpmath.matrix([(angle + mpmath.pi) % (2 * mpmath.pi) - mpmath.pi for angle in gap])

    def errors(self, mean: Array, covariance: Any) -> list[float]:
        """Of a belief, in units of this one's: ``‖L⁻¹ δx‖``, and the largest entry of ``L⁻¹ P' L⁻ᵀ − I``."""
        inverse = mpmath.cholesky(self.P) ** -1
        excess = inverse * covariance * inverse.T - mpmath.eye(len(self.x))
        return [float(mpmath.norm(inverse * (exact(mean) - self.x))), float(max(abs(e) for e in excess))]


def exact(matrix: Array) -> Any:
    """The same numbers as an mpmath matrix."""
    return mpmath.matrix(matrix.tolist())


def true_bearing(x: Any, pose: Pose) -> list[Any]:
    east, north = (x[i] - mpmath.mpf(float(pose.position[i, 0])) for i in range(2))
    return [mpmath.atan2(east, north)]


def positions(x: Any, _: Pose) -> list[Any]:
    return [x[0], x[1]]


def fly_against_fifty_digits(
    begin: Callable[..., Simulation], scenario: Scenario, sigmas: list[float], measure: Any, angular: bool
) -> tuple[np.ndarray, int]:
    """Largest errors of mean and covariance, our filter's and then the plain one's, and the plain one's repairs.

    The prior is centred some metres off the truth, however wide it is: this is about arithmetic, not convergence.
    """
    root, plain = (begin(with_tracker(scenario, kind)) for kind in (SquareRootKalman, UnscentedKalman))
    for simulation in (root, plain):
        mean = simulation.truth + np.array([5.0, -8.0, 0.3, -0.4])[:, None]
        simulation.track.start(np.arange(1), mean, np.diag(np.square(sigmas))[..., None])
    found = []
    with mpmath.workdps(50):
        twin = FiftyDigits(root, measure, angular)
        watched(root, twin.step)
        while not root.truncated.all():
            action = np.ones((scenario.action_size, 1))
            for simulation in (root, plain):
                simulation.step(action)
            assert (diagonal(root.track.root) > 0.0).all()
            assert float(twin.nis) == pytest.approx(root.track.nis[0], rel=1e-4, abs=1e-4)
            factor = exact(root.track.root[..., 0])
            ours = twin.errors(root.track.mean, factor * factor.T)
            found.append(ours + twin.errors(plain.track.mean, exact(plain.track.covariance[..., 0])))
    assert not root.track.repairs.any()
    return np.array(found).max(axis=0), int(plain.track.repairs[0])


STEPS = 60


def test_sound_where_the_plain_filter_needs_repairs(begin: Callable[..., Simulation]) -> None:
    """A position to a micrometre where it was known to a thousand kilometres: twelve orders, 24 in the covariance.

    The first look at the velocity cancels what the prior said, nine of the root's sixteen digits. Positions of tens of
    kilometres are rounded to 1e-5 of a micrometre, and 60 steps add up. The plain filter is wrong by more than its
    standard deviations.
    """
    changes = {"sensors.0.sigma": 1e-6, "sensors.0.correlation": 0.0}
    changes |= {"episode.steps": STEPS, "episode.decision_every": 1}
    scenario = POSITION.override({**changes, "tracker.motion.acceleration_noise": 0.0})
    errors, repairs = fly_against_fifty_digits(begin, scenario, [1e6, 1e6, 1e3, 1e3], positions, angular=False)
    assert errors[0] < 1e-2
    assert errors[1] < 1e-4
    assert errors[2] > 1.0
    assert repairs > 0


def test_more_exact_where_the_plain_filter_still_runs(begin: Callable[..., Simulation]) -> None:
    """Bearings to a nanoradian from a turning own ship, of an emitter known to a thousand kilometres.

    Bearings are rounded to 4e-7 of their noise, and a manoeuvre turns that into some 1e-5 of the range's.
    """
    changes = {"sensors.0.sigma": 1e-9}
    changes |= {"episode.steps": STEPS, "episode.decision_every": 1, "tracker.motion.acceleration_noise": 0.0}
    scenario = SCENARIOS["BearingsOnly"].override(changes)
    errors, _ = fly_against_fifty_digits(begin, scenario, [1e6, 1e6, 1e2, 1e2], true_bearing, angular=True)

    assert errors[0] < 1e-3
    assert errors[1] < 1e-5
    assert (errors[2:] > 30.0 * errors[:2]).all()


# Health.

TRACKERS = {
    **SCENARIOS,
    "unknown turn": Scenario().override({"tracker.motion": TURNING}),
    "acceleration": Scenario().override({"tracker.motion": ConstantAcceleration(acceleration_noise=0.1)}),
}


@pytest.mark.parametrize("scenario", TRACKERS.values(), ids=list(TRACKERS))
def test_covariance_is_the_square_of_the_root(scenario: Scenario, begin: Callable[..., Simulation]) -> None:
    simulation, rng = begin(with_tracker(scenario), 8), np.random.default_rng(2)
    track, predict = simulation.track, simulation.track.predict

    def check() -> None:
        root = np.moveaxis(track.root, -1, 0)
        np.testing.assert_array_equal(np.triu(root, 1), 0.0)
        assert (diagonal(track.root) > 0.0).all()
        np.testing.assert_array_equal(track.covariance, track.covariance.swapaxes(0, 1))
        sigma = np.sqrt(diagonal(track.covariance))
        square = np.moveaxis(root @ root.swapaxes(1, 2), 0, -1)
        np.testing.assert_allclose((square - track.covariance) / sigma[:, None] / sigma, 0.0, atol=1e-15)
        assert not unsound(track.covariance).any()

    def checked(time: Array) -> None:
        predict(time)
        check()

    check()
    track.predict = checked  # type: ignore[method-assign]
    for _ in range(5):
        simulation.step(rng.uniform(-1, 1, (scenario.action_size, 8)))
        check()
    assert not track.repairs.any()


def test_a_prior_that_is_none_is_repaired_and_counted(begin: Callable[..., Simulation]) -> None:
    track = begin(with_tracker(SCENARIOS["BearingDoppler"]), 3).track
    mean, covariance = track.mean.copy(), track.covariance.copy()
    spoilt = covariance.copy()
    spoilt[0, 1, 1] = spoilt[1, 0, 1] = 2.0 * np.sqrt(covariance[0, 0, 1] * covariance[1, 1, 1])
    track.start(np.arange(3), mean, spoilt)
    np.testing.assert_array_equal(track.repairs, [0, 1, 0])
    assert (diagonal(track.root) > 0.0).all()
    np.testing.assert_allclose(track.covariance[..., [0, 2]], covariance[..., [0, 2]], rtol=1e-12)


def test_a_weight_that_makes_nonsense_of_the_spread_is_cut_and_counted(begin: Callable[..., Simulation]) -> None:
    """With β far below zero the filter's own arithmetic is indefinite; the root stays one, and ``repairs`` tells."""
    scenario = with_tracker(SCENARIOS["BearingsOnly"].override({"prior.range_sigma": 30e3}), beta=-1e4)
    simulation = begin(scenario, 3)
    for _ in range(3):
        simulation.step(np.zeros((1, 3)))
    track = simulation.track
    assert (track.repairs > 0).all()
    assert np.isfinite(track.mean).all()
    assert (diagonal(track.root) > 0.0).all()


@pytest.mark.parametrize("field", ["mean", "root"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_track_that_went_non_finite_begins_anew(field: str, value: float, begin: Callable[..., Simulation]) -> None:
    """Nothing inside a step raises, the restart is counted, and the neighbours notice nothing."""
    scenario = with_tracker(SCENARIOS["BearingDoppler"])
    simulation, control = begin(scenario, 3), begin(scenario, 3)

    def spoil(spoilt: Simulation) -> None:
        if spoilt.step_count[1] == 2:
            getattr(spoilt.track, field)[..., 1] = value

    simulation.watchers.append(spoil)
    for each in (simulation, control):
        each.step(np.zeros((1, 3)))
    np.testing.assert_array_equal(simulation.track.repairs, [0, 1, 0])
    for name, values in control.track.state_arrays().items():
        found = simulation.track.state_arrays()[name]
        assert np.isfinite(found).all()
        np.testing.assert_array_equal(found[..., [0, 2]], values[..., [0, 2]])


@pytest.mark.parametrize("beta", [2.0, 0.0])
@pytest.mark.parametrize("motion", [ConstantVelocity(acceleration_noise=0.5), TURNING], ids=["linear", "nonlinear"])
def test_bits_do_not_depend_on_the_batch(motion: Motion, beta: float, begin: Callable[..., Simulation]) -> None:
    """N = 1, 2 and 7, with missed detections, random noise and, for β = 0, a downdate."""
    changes = {"sensors.0.detection_probability": 0.5, "sensors.0.sigma": LogUniform(low=1e-3, high=1e-2)}
    scenario = SCENARIOS["BearingDopplerUnknownCarrier"].override(changes)
    scenario = with_tracker(scenario, motion=motion, beta=beta, kappa=-1.0)
    batches = {size: begin(scenario, size) for size in (1, 2, 7)}
    for _ in range(8):
        for size, simulation in batches.items():
            simulation.step(np.linspace(-1.0, 1.0, 7)[None, :size])
    for name, values in batches[7].track.state_arrays().items():
        for size, simulation in batches.items():
            found = simulation.track.state_arrays()[name]
            assert found.tobytes() == values[..., :size].tobytes(), f"{name} at {size}"


def test_state_is_restored_to_the_last_bit() -> None:
    env = LocalisationEnv(with_tracker(SCENARIOS["BearingDoppler"]))
    env.reset(seed=0)
    env.step(np.array([0.5]))
    state = env.get_state()
    first = env.step(np.array([-0.5]))[0]
    env.step(np.array([0.2]))
    env.set_state(state)
    assert env.step(np.array([-0.5]))[0].tobytes() == first.tobytes()


def test_configuration_is_the_unscented_filters(refusal: Callable[..., ScenarioError]) -> None:
    for field in ("motion", "alpha", "beta", "kappa"):
        assert getattr(SquareRootKalman(), field) == getattr(UnscentedKalman(), field)
    scenario = with_tracker(SCENARIOS["BearingDoppler"], alpha=0.7, kappa=0.5)
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario
    assert replace(again.tracker, alpha=1.0).kappa == 0.5
    spreadless = with_tracker(SCENARIOS["BearingsOnly"], kappa=-4.0)
    assert refusal(Simulation, spreadless, 1).field == "kappa"
