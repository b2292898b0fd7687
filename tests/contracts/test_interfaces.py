"""The hardest later case, built from outside: whatever a scenario needs can be added without touching the core.

Two satellites on straight three-dimensional tracks yaw at command, carry interferometers along their body axes, hear
one emitter with five scalars of three kinds, one of them biased, and know their attitude and position only roughly.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from passloc_env import LocalisationEnv, LocalisationVectorEnv, Scenario, ScenarioError, observation_names
from passloc_env.arrays import Number
from passloc_env.batch import TILE
from passloc_env.belief import BeliefFeatures
from passloc_env.distributions import Uniform
from passloc_env.fields import count, quantity, vector
from passloc_env.motion import ConstantVelocity
from passloc_env.nuisance import Nuisance
from passloc_env.platforms import FixedStation, Platform, Pose, stack
from passloc_env.scenario import Bound, Episode
from passloc_env.sensors import Sensor
from passloc_env.sensors.sensor import scalar_covariance
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import StatePrior, UnscentedKalman
from passloc_env.units import SPEED_OF_LIGHT


@dataclass(frozen=True, kw_only=True)
class YawingSatellite(Platform):
    """A straight track; one action sets the yaw rate. It reports a slightly wrong attitude and position."""

    controls = 1
    set_points = 1
    dimension = 3

    position: tuple[Number, ...] = vector("where it starts", unit="m")
    velocity: tuple[Number, ...] = vector("along its track", unit="m/s")
    yaw: Number = quantity("heading of its first axis", 0.0, unit="rad")
    max_yaw_rate: Number = quantity("largest yaw rate", 0.02, unit="rad/s", above=0)
    attitude_error: Number = quantity("reported minus true yaw", 0.0, unit="rad")
    navigation_error: Number = quantity("reported minus true position, each axis", 0.0, unit="m")

    def start(self, environments):
        return stack((*self.position, *self.velocity, self.yaw, 0.0), environments)

    def set_point(self, state, action, line_of_sight):
        return action * self.max_yaw_rate

    def move(self, state, set_point, period):
        moved = state.copy()
        moved[:3] += period * state[3:6]
        moved[6] += period * set_point[0]
        moved[7] = set_point[0]
        return moved

    def pose(self, state):
        return self._posed(state[:3], state[3:6], state[6], state[7])

    def reported_pose(self, state, pose, errors):
        position = pose.position + self.navigation_error
        return self._posed(position, pose.velocity, state[6] + self.attitude_error, state[7])

    def _posed(self, position, velocity, yaw, rate):
        zero, one = np.zeros(yaw.shape), np.ones(yaw.shape)
        forward = np.stack([np.sin(yaw), np.cos(yaw), zero])
        starboard = np.stack([np.cos(yaw), -np.sin(yaw), zero])
        upward = np.stack([zero, zero, one])
        turning = np.stack([rate * starboard, -rate * forward, np.zeros(position.shape)])
        return Pose(position, velocity, np.zeros(position.shape), np.stack([forward, starboard, upward]), turning)


def _spread(values, line):
    """Values ``(…, N)`` of the platform with the middle axes of the sight line's states."""
    return values.reshape(*values.shape[:-1], *(1,) * (line.offset.ndim - 2), values.shape[-1])


@dataclass(frozen=True, kw_only=True)
class BodyAxisPhase(Sensor):
    """Phase difference of two antennas along a body axis: ``2π d/λ`` times the direction cosine, plus a bias."""

    angular = (True,)

    sigma: Number = quantity("standard deviation", unit="rad", above=0)
    axis: int = count("body axis of the baseline", 0)
    wavelengths: Number = quantity("length of the baseline in wavelengths", 1.0, above=0)
    bias_sigma: Number = quantity("prior standard deviation of a constant bias", 0.0, unit="rad", at_least=0)
    platform: int = count("which platform", 0)
    lever_arm: tuple[Number, ...] = vector("where on it", (), unit="m")
    detection_probability: Number = quantity("chance of a measurement", 1.0, above=0, at_most=1)

    @property
    def _bias(self):
        return f"phase bias {self.platform} {self.axis}"

    @property
    def nuisances(self):
        if isinstance(self.bias_sigma, float) and self.bias_sigma == 0.0:
            return ()
        return (Nuisance(self._bias, self.bias_sigma),)

    def _baseline(self, line):
        return _spread(2 * np.pi * self.wavelengths * line.pose.attitude[self.axis], line)

    def measure(self, scene):
        line = scene.sightline(self.platform, self.lever_arm)
        phase = (self._baseline(line) * line.direction).sum(axis=0)
        if self.nuisances:
            phase = phase + scene.nuisance(self._bias)
        return phase[None]

    def jacobian(self, scene):
        line, rows = scene.sightline(self.platform, self.lever_arm), scene.empty_jacobian(1)
        baseline = self._baseline(line)
        along = (baseline * line.direction).sum(axis=0)
        rows[0, scene.layout.position] = (baseline - along * line.direction) / line.range
        if self.nuisances:
            rows[0, scene.layout.nuisance_row(self._bias)] = 1.0
        return rows

    def noise_covariance(self):
        return scalar_covariance(self.sigma)


@dataclass(frozen=True, kw_only=True)
class ArrivalDifference(Sensor):
    """Time difference of arrival between two platforms, µs."""

    sigma: Number = quantity("standard deviation", unit="µs", above=0)
    platform: int = count("the first platform", 0)
    other: int = count("the second platform", 1)
    lever_arm: tuple[Number, ...] = vector("where on both", (), unit="m")
    detection_probability: Number = quantity("chance of a measurement", 1.0, above=0, at_most=1)

    @property
    def platforms(self):
        return (self.platform, self.other)

    def _lines(self, scene):
        return [scene.sightline(platform, self.lever_arm) for platform in self.platforms]

    def measure(self, scene):
        first, second = self._lines(scene)
        return ((first.range - second.range) * (1e6 / SPEED_OF_LIGHT))[None]

    def jacobian(self, scene):
        first, second = self._lines(scene)
        rows = scene.empty_jacobian(1)
        rows[0, scene.layout.position] = (first.direction - second.direction) * (1e6 / SPEED_OF_LIGHT)
        return rows

    def noise_covariance(self):
        return scalar_covariance(self.sigma)


@dataclass(frozen=True, kw_only=True)
class ClosingRate(Sensor):
    """Rate of change of the range, m/s."""

    sigma: Number = quantity("standard deviation", unit="m/s", above=0)
    platform: int = count("which platform", 0)
    lever_arm: tuple[Number, ...] = vector("where on it", (), unit="m")
    detection_probability: Number = quantity("chance of a measurement", 1.0, above=0, at_most=1)

    def measure(self, scene):
        return scene.sightline(self.platform, self.lever_arm).range_rate[None]

    def jacobian(self, scene):
        line, rows = scene.sightline(self.platform, self.lever_arm), scene.empty_jacobian(1)
        rows[0, scene.layout.velocity] = line.direction
        rows[0, scene.layout.position] = (line.velocity - line.range_rate * line.direction) / line.range
        return rows

    def noise_covariance(self):
        return scalar_covariance(self.sigma)


POSITION_SIGMA, VELOCITY_SIGMA, BIAS_SIGMA = 5e3, 100.0, 0.05
PAIR = Scenario(
    name="SatellitePair",
    target=Target(
        start=CartesianStart(
            position=(Uniform(low=-5e4, high=5e4), Uniform(low=-5e4, high=5e4), 9e3), velocity=(150.0, -120.0, 0.0)
        )
    ),
    platforms=(
        YawingSatellite(
            position=(-3e5, -2.5e5, 5e5),
            velocity=(0.0, 7.5e3, 0.0),
            yaw=0.4,
            attitude_error=Uniform(low=-2e-4, high=2e-4),
            navigation_error=2.0,
        ),
        YawingSatellite(
            position=(2.5e5, -1e5, 5.5e5), velocity=(-2e3, 7e3, 100.0), attitude_error=Uniform(low=-2e-4, high=2e-4)
        ),
    ),
    sensors=(
        BodyAxisPhase(sigma=0.01, axis=0, platform=0),
        BodyAxisPhase(sigma=0.01, axis=1, platform=0, lever_arm=(1.0, -0.5, 0.2)),
        BodyAxisPhase(sigma=0.01, axis=1, platform=1, bias_sigma=BIAS_SIGMA),
        ArrivalDifference(sigma=0.3),
        ClosingRate(sigma=1.0, platform=1, lever_arm=(0.0, 2.0, 0.0)),
    ),
    prior=StatePrior(position_sigma=POSITION_SIGMA, velocity_sigma=VELOCITY_SIGMA),
    tracker=UnscentedKalman(motion=ConstantVelocity()),
    bound=Bound(motion=ConstantVelocity()),
    observation=BeliefFeatures(range_scale=6e5, speed_scale=5e3, nuisance_scale=BIAS_SIGMA),
    episode=Episode(steps=48, period=1.0, decision_every=4, min_range=1e5),
)
HONEST = PAIR.override(
    {"platforms.0.attitude_error": 0.0, "platforms.0.navigation_error": 0.0, "platforms.1.attitude_error": 0.0}
)
STATES, SIZE = 7, 256


def flown(scenario, environments=SIZE, actions=0.5):
    """The world after an episode of alternating yaw."""
    world = Simulation(scenario, environments)
    world.reset(np.arange(environments), [np.random.default_rng(seed) for seed in range(environments)])
    for decision in range(scenario.episode.steps // scenario.episode.decision_every):
        world.step(np.full((scenario.action_size, environments), actions if decision % 4 < 3 else -actions))
    return world


def position_error(world):
    return np.sqrt((world.outcome.position_error**2).sum(axis=0))


def test_shapes_and_names():
    assert (PAIR.dimension, PAIR.action_size, PAIR.own_ship) == (3, 2, 0)
    world = flown(PAIR, 4)
    assert world.models.tracker.layout.nuisance == ("phase bias 1 1",)
    assert world.truth.shape == world.track.mean.shape == (STATES, 4)
    assert world.track.covariance.shape == world.information.bound.shape == (STATES, STATES, 4)
    assert world.models.suite.size == 5
    names = observation_names(PAIR)
    assert len(names) == len(world.observe()) == 1 + 3 + 3 + 3 + 7 + 21 + 1 + 2
    assert names[7:10] == ("platform 1 offset along", "platform 1 offset across", "platform 1 offset up")


def test_jacobian_by_finite_differences():
    world = flown(PAIR, 5)
    suite, layout, poses = world.models.suite, world.models.tracker.layout, world.belief.poses
    rng, middle = np.random.default_rng(0), 3
    states = world.truth[:, None] + np.array([1e4, 1e4, 1e4, 50, 50, 50, 0.1])[:, None, None] * rng.standard_normal(
        (STATES, middle, 5)
    )
    analytic = suite.jacobian(Scene(states, layout, poses))
    assert analytic.shape == (5, STATES, middle, 5)
    for row, step in enumerate([10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 1e-3]):
        push = np.zeros((STATES, 1, 1))
        push[row] = step
        ahead, behind = (suite.measure(Scene(states + sign * push, layout, poses)) for sign in (1, -1))
        numeric = suite.difference(ahead, behind) / (2 * step)
        scale = np.abs(analytic[:, row]).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(analytic[:, row], numeric, rtol=1e-5, atol=1e-6 * scale.max() + 1e-12)


def test_lever_arms_may_be_computed_on_the_fly():
    world = flown(HONEST, 2)
    scene = Scene(world.truth, world.models.truth.layout, world.poses())
    ranges = [scene.sightline(0, (100.0 * step, 0.0, 0.0)).range[0] for step in range(20)]
    forward = world.poses()[0].attitude[0] * scene.sightline(0).direction
    np.testing.assert_allclose(np.diff(ranges), -100.0 * forward[:, 0].sum(), rtol=0.02)


def test_a_mounted_point_takes_part_in_the_rotation():
    satellite, lever_arm, period = (
        YawingSatellite(position=(0, 0, 0), velocity=(9, 5, 1), yaw=0.3),
        (3.0, -2.0, 0.5),
        0.1,
    )
    states = [satellite.start(1)]
    for _ in range(3):
        states.append(satellite.move(states[-1], np.full((1, 1), 0.02), period))
    before, now, after = (satellite.pose(state).mounted(lever_arm) for state in states[1:])
    velocity = (after.position - before.position) / (2 * period)
    acceleration = (after.position - 2 * now.position + before.position) / period**2
    np.testing.assert_allclose(now.velocity, velocity, rtol=1e-5)
    np.testing.assert_allclose(now.acceleration, acceleration, rtol=1e-5, atol=1e-9)
    assert np.abs(acceleration).max() > 1e-3


def test_it_localises():
    world = flown(PAIR)
    error = position_error(world)
    assert np.median(error) < 0.1 * POSITION_SIGMA
    assert error.max() < POSITION_SIGMA
    assert (world.track.repairs == 0).all()
    prior = np.array([POSITION_SIGMA] * 3 + [VELOCITY_SIGMA] * 3 + [BIAS_SIGMA])
    bound = np.sqrt(np.einsum("iin->in", world.information.bound))
    assert np.isfinite(bound).all()
    assert (bound < prior[:, None]).all()
    assert (bound[:3] < 0.1 * POSITION_SIGMA).all()
    assert not world.terminated.any()
    assert world.truncated.all()


def test_it_is_consistent_and_efficient():
    """Honest poses: NEES averages the seven states, and the error is what the bound allows."""
    size = 1024
    world = flown(HONEST, size)
    assert abs(world.outcome.nees.mean() - STATES) < 4 * np.sqrt(2 * STATES / size)
    allowed = np.sqrt(np.einsum("iin->", world.information.bound[:3, :3]) / size)
    achieved = np.sqrt((position_error(world) ** 2).mean())
    assert 0.85 < achieved / allowed < 1.25
    own = np.sqrt(np.einsum("iin->", world.track.covariance[:3, :3]) / size)
    assert 0.85 < own / allowed < 1.25
    bias = world.track.mean[6] - world.truth[6]
    assert np.sqrt((bias**2).mean()) < 0.5 * BIAS_SIGMA
    assert world.truth[6].std() == pytest.approx(BIAS_SIGMA, rel=0.15)


def test_small_pose_errors_are_survived():
    assert 5.0 < flown(PAIR).outcome.nees.mean() < 10.0


def test_world_measures_from_the_true_pose_and_tracker_from_the_reported_one():
    """Control: a large attitude error must show, and only in the belief."""
    wrong = HONEST.override({"platforms.0.attitude_error": 0.05, "platforms.1.attitude_error": 0.05})
    honest, misled = flown(HONEST), flown(wrong)
    assert np.median(misled.outcome.nees) > 100.0
    assert np.median(position_error(misled)) > 5 * np.median(position_error(honest))
    assert np.array_equal(honest.truth, misled.truth)
    assert np.array_equal(honest.information.bound, misled.information.bound)
    told, true = misled.belief.poses[0], misled.poses()[0]
    cosine = (told.attitude[0] * true.attitude[0]).sum(axis=0)
    np.testing.assert_allclose(cosine, np.cos(0.05))


def test_yaw_is_commanded():
    left, right = flown(HONEST, 2, actions=1.0), flown(HONEST, 2, actions=0.0)
    assert not np.array_equal(left.platform_states[0][6], right.platform_states[0][6])
    assert np.array_equal(left.platform_states[0][:3], right.platform_states[0][:3])
    assert not np.array_equal(left.track.covariance, right.track.covariance)


def test_a_fixed_station_may_take_part():
    station = FixedStation(position=(2.5e5, -1e5, 10.0))
    world = flown(HONEST.replace(platforms=(HONEST.platforms[0], station)))
    assert world.scenario.action_size == 1
    assert world.belief.poses[1].attitude.shape == (3, 3, SIZE)
    assert np.median(position_error(world)) < 0.2 * POSITION_SIGMA
    assert abs(world.outcome.nees.mean() - STATES) < 5 * np.sqrt(2 * STATES / SIZE)


def test_missed_detections():
    missing = HONEST.override({f"sensors.{index}.detection_probability": 0.3 for index in range(5)})
    world, seen = Simulation(missing, SIZE), []
    measure = world.measure
    world.measure = lambda scene, *columns: seen.append(measure(scene, *columns)) or seen[-1]
    world.reset(np.arange(SIZE), [np.random.default_rng(seed) for seed in range(SIZE)])
    for _ in range(12):
        world.step(np.zeros((2, SIZE)))
    detected = np.stack([mask for _, mask in seen])
    assert detected.shape == (49, 5, SIZE)
    assert detected.mean(axis=(0, 2)) == pytest.approx([0.3] * 5, abs=0.02)
    assert np.corrcoef(detected[:, 0].ravel(), detected[:, 1].ravel())[0, 1] == pytest.approx(0.0, abs=0.03)
    assert abs(world.outcome.nees.mean() - STATES) < 5 * np.sqrt(2 * STATES / SIZE)
    everything = flown(HONEST, actions=0.0)
    assert np.median(position_error(world)) < 0.2 * POSITION_SIGMA
    assert (world.outcome.range_sigma > everything.outcome.range_sigma).mean() > 0.95


def test_nothing_detected_tells_nothing():
    deaf = HONEST.override({f"sensors.{index}.detection_probability": 1e-12 for index in range(5)})
    world = flown(deaf, 8)
    elapsed = deaf.episode.duration
    expected = POSITION_SIGMA**2 + (elapsed * VELOCITY_SIGMA) ** 2
    for covariance in (world.track.covariance, world.information.bound):
        np.testing.assert_allclose(covariance[0, 0], expected, rtol=1e-9)
        np.testing.assert_allclose(covariance[6, 6], BIAS_SIGMA**2, rtol=1e-9)
    assert (world.reward_terms["gram_gain"] == 0.0).all()


@pytest.mark.parametrize("numbers", ["fixed", "random"])
def test_gymnasium_accepts_it(numbers):
    changes = {"sensors.0.sigma": Uniform(low=5e-3, high=2e-2)} if numbers == "random" else {}
    env = LocalisationEnv(PAIR, overrides=changes, diagnostics=True)
    check_env(env, skip_render_check=True)
    env.reset(seed=1)
    observation, _, _, _, info = env.step(np.array([0.5, -0.5]))
    assert observation in env.observation_space
    assert info["truth"].shape == (STATES,)
    assert (observation[-2:] == (0.5, -0.5)).all()


@pytest.mark.parametrize("num_envs", [1, 3, 17])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_same_in_every_batch(num_envs, mode, assert_same, actions):
    changes = {
        "episode.steps": 12,
        "sensors.3.detection_probability": 0.6,
        "sensors.0.sigma": Uniform(low=0.01, high=0.02),
    }
    native = LocalisationVectorEnv(num_envs, PAIR, overrides=changes, autoreset_mode=mode, diagnostics=True)
    synced = SyncVectorEnv(
        [lambda: LocalisationEnv(PAIR, overrides=changes, diagnostics=True)] * num_envs,
        autoreset_mode=AutoresetMode(mode),
    )
    assert_same(native.reset(seed=3), synced.reset(seed=3))
    stream, ends = actions(num_envs, 2), 0
    for decision in range(9):
        action = next(stream)
        ours = native.step(action)
        assert_same(ours, synced.step(action), f"decision {decision}")
        ends += ours[3].sum()
    assert ends >= 2 * num_envs


def test_same_over_tiles(assert_same):
    rows = slice(TILE - 1, TILE + 2)
    whole, part = LocalisationVectorEnv(TILE + 3, PAIR), LocalisationVectorEnv(3, PAIR)
    first, _ = whole.reset(seed=0)
    last, _ = part.reset(seed=rows.start)
    assert_same(first[rows], last)
    action = np.full((TILE + 3, 2), 0.3, np.float32)
    assert_same(whole.step(action)[0][rows], part.step(action[:3])[0])
    joined, own = whole.belief, part.belief
    assert_same(joined.covariance[..., rows].copy(), own.covariance)
    for ours, theirs in zip(joined.poses, own.poses, strict=True):
        assert_same(ours.attitude[..., rows].copy(), theirs.attitude)
    assert_same(joined.platforms[0].attitude_error[rows], own.platforms[0].attitude_error)


def test_state_goes_back(assert_same, actions):
    env, stream = LocalisationVectorEnv(3, PAIR, overrides={"episode.steps": 12}, diagnostics=True), actions(3, 2)
    env.reset(seed=1)
    env.step(next(stream))
    state, later = env.get_state(), [next(stream) for _ in range(5)]
    expected = [env.step(action) for action in later]
    env.set_state(state)
    assert_same([env.step(action) for action in later], expected)


def test_it_can_be_written_down():
    assert Scenario.from_json(PAIR.to_json()) == PAIR
    assert Scenario.from_yaml(PAIR.to_yaml()) == PAIR
    assert LocalisationEnv(PAIR.to_dict()).scenario == PAIR
    assert PAIR.override({"sensors.ArrivalDifference.sigma": 1.0}).sensors[3].sigma == 1.0


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"sensors.3.other": 2}, "sensors.3.other = 2 is not possible: there is no such platform"),
        ({"sensors.1.lever_arm": [1.0, 2.0]}, "sensors.1.lever_arm = .* 3 axes"),
        ({"platforms.0.max_yaw_rate": 0}, "platforms.0.max_yaw_rate = 0 .* above 0 rad/s"),
        ({"target.start.position": [0, 0], "target.start.velocity": [1, 1]}, "must have 2 axes like the emitter"),
    ],
)
def test_its_parts_are_validated(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        PAIR.override(overrides)
