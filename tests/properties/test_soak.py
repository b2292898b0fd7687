"""Nothing inside an episode raises, warns or leaves the numbers, whatever the actions and wherever the emitter is."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from passloc_env import SCENARIOS, LocalisationVectorEnv
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from passloc_env.target import PolarStart
from training.reliability.flight import fly_leg
from training.reliability.leg import draw

SIZE = 64
SENSOR_STEPS = 144
"""Per environment and test."""

DIAGNOSTICS = ("truth", "estimate", "covariance", "nees", "relative_range_error", "bound", "range", "repairs", "gated")
EXTREMES = [1.0, -1.0, 0.0, 1e30, -1e30, 5e-324, -5e-324, 3.4e38, 1.7e308]


def extreme_actions(size, seed):
    """Endless actions: half of the environments keep to an extreme each, the others alternate or act at random."""
    rng, sign = np.random.default_rng(seed), 1.0
    while True:
        action = np.empty((SIZE, size))
        action[0::2] = np.resize(EXTREMES, (SIZE // 2, 1))
        action[1::4] = sign = -sign
        action[3::4] = rng.uniform(-1, 1, (SIZE // 4, size)) * 10.0 ** rng.integers(-3, 3)
        yield action


def flights_at(size, seed):
    """Endless actions that fly at the emitter, a few of them not quite."""
    rng = np.random.default_rng(seed)
    while True:
        action = np.zeros((SIZE, size))
        action[::4] = rng.uniform(-0.02, 0.02, action[::4].shape)
        yield action


def head_on(name):
    """Overrides that let the emitter come from 2 km away, straight through the observer, or wait to be driven over."""
    start = SCENARIOS[name].target.start
    changes = {"episode.min_range": 0.0, "episode.decision_every": 1}
    if name == "CrossFix":
        return changes | {"target.start.position": [100.0, 0.0], "platforms.0.position": [0.0, 0.0]}
    if isinstance(start, PolarStart):
        line = {"target.start.bearing": 0.3, "target.start.course": 0.3 + math.pi, "target.start.speed": 100.0}
        return changes | line | {"target.start.range": 2e3}
    speed = math.hypot(*start.velocity)
    # Aircraft that accelerate or turn as they come must be near, or they would bend away.
    distance = min(2e3, 5.0 * speed) if speed > 50.0 else 2e3
    towards = [-axis / math.hypot(*start.position) for axis in start.position]
    return changes | {
        "platforms.0.heading": math.atan2(*start.position),
        "target.start.position": [-distance * axis for axis in towards],
        "target.start.velocity": [speed * axis for axis in towards],
    }


def assert_finite(env, result):
    """Observations, rewards, infos and means are numbers."""
    observation, reward, _, _, info = result
    assert observation in env.observation_space
    assert np.isfinite(reward).all()
    for values in (*info["reward_terms"].values(), *(info[key] for key in DIAGNOSTICS)):
        assert np.isfinite(values).all()
    assert np.isfinite(env.belief.mean).all()


def assert_sound(env, result):
    """All of that, and every covariance is positive definite, scaled to a correlation."""
    assert_finite(env, result)
    covariance = env.belief.covariance
    sigma = np.sqrt(np.einsum("iin->in", covariance))
    assert (sigma > 0.0).all()
    correlation = np.moveaxis(covariance / sigma[:, None] / sigma[None], -1, 0)
    assert np.linalg.eigvalsh(correlation).min() > 0.0


def assert_symmetric(env, result):
    """Beliefs and bounds are symmetric to the last bit."""
    for covariance in (env.belief.covariance, env.batch.tiles[0].information.bound):
        assert np.array_equal(covariance, covariance.swapaxes(0, 1))


def soak(name, actions, check=assert_sound, **changes):
    """Fly a whole batch for a while; the largest count of repairs and how close anybody came."""
    env = LocalisationVectorEnv(SIZE, name, overrides=changes, autoreset_mode="SameStep", diagnostics=True)
    env.reset(seed=2)
    repairs, closest, before = 0, np.inf, np.zeros(SIZE)
    stream = actions(env.scenario.action_size, seed=1)
    for _ in range(-(-SENSOR_STEPS // env.scenario.episode.decision_every)):
        result = env.step(next(stream))
        check(env, result)
        going = ~(result[2] | result[3])
        assert (result[4]["repairs"][going] >= before[going]).all()
        before = result[4]["repairs"]
        repairs, closest = max(repairs, before.max()), min(closest, result[4]["range"].min())
    return repairs, closest


@pytest.mark.parametrize("early_end", [True, False])
@pytest.mark.parametrize("name", SCENARIOS)
def test_extreme_actions(name, early_end):
    repairs, _ = soak(name, extreme_actions, **{"episode.early_end": early_end})
    assert repairs < SENSOR_STEPS


@pytest.mark.parametrize("early_end", [True, False])
@pytest.mark.parametrize("name", [name for name in SCENARIOS if name != "DualSatellite"])
def test_emitters_that_pass_through(name, early_end):
    repairs, closest = soak(name, flights_at, **head_on(name), **{"episode.early_end": early_end})
    assert early_end or closest < 400.0
    assert repairs < SENSOR_STEPS


@pytest.mark.parametrize("sharpness", [1e-4, 1e-6])
@pytest.mark.parametrize("name", SCENARIOS)
def test_sensors_far_sharper_than_the_prior(name, sharpness):
    sigmas = {f"sensors.{i}.sigma": sharpness * sensor.sigma for i, sensor in enumerate(SCENARIOS[name].sensors)}
    repairs, _ = soak(name, extreme_actions, assert_finite, **sigmas)
    assert repairs < SENSOR_STEPS


@pytest.mark.parametrize("name", SCENARIOS)
def test_covariances_are_symmetric_to_the_last_bit(name):
    repairs, _ = soak(name, extreme_actions, assert_symmetric)
    assert repairs < SENSOR_STEPS


def test_soak_is_long_enough():
    """Of extreme actions, over every scenario, with early ends and without."""
    assert 2 * len(SCENARIOS) * SIZE * SENSOR_STEPS >= 100_000


@pytest.fixture
def world():
    world = Simulation(SCENARIOS["BearingDopplerUnknownCarrier"], 4)
    world.reset(np.arange(4), [np.random.default_rng(seed) for seed in range(4)])
    world.step(np.zeros((1, 4)))
    return world


@pytest.mark.parametrize("damage", ["indefinite", "singular", "rounding"])
def test_spoilt_covariance_is_repaired_and_counted(world, damage):
    covariance = world.track.covariance[..., 2]
    if damage == "indefinite":
        covariance[0, 1] = covariance[1, 0] = 2 * math.sqrt(covariance[0, 0] * covariance[1, 1])
    elif damage == "singular":
        covariance[...] = np.outer(np.sqrt(np.diag(covariance)), np.sqrt(np.diag(covariance)))
    else:
        covariance[2, 2] = -1e-9
    world.step(np.zeros((1, 4)))
    assert world.track.repairs[2] >= 1
    assert (world.track.repairs[[0, 1, 3]] == 0).all()
    assert np.isfinite(world.observe()).all()
    assert np.linalg.eigvalsh(np.moveaxis(world.track.covariance, -1, 0)).min() > 0


@pytest.mark.parametrize("poison", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["mean", "covariance"])
def test_broken_belief_begins_anew_and_is_counted(world, part, poison):
    def spoil(world):
        world.watchers.clear()
        getattr(world.track, part)[0, ..., 2] = poison

    world.watchers.append(spoil)
    world.step(np.zeros((1, 4)))
    assert not world.watchers
    assert world.track.repairs.tolist() == [0, 0, 1, 0]
    assert np.isfinite(world.track.mean).all()
    assert np.isfinite(world.track.covariance).all()
    assert np.isfinite(world.reward).all()
    assert np.isfinite(world.observe()).all()


@settings(deadline=None, derandomize=True, max_examples=20)
@given(seed=some.integers(0, 2**32 - 1), number=some.integers(0, 2**16))
def test_any_leg_of_a_soak_breaks_nothing(seed, number):
    """Over scenarios, sensors that fail, trackers, batches and actions, as `passloc soak` draws them."""
    told = []
    leg = draw(seed, number, most=8)
    tally = fly_leg(leg, 200, told.append)
    assert told == []
    assert tally.sound
    assert tally.repairs <= 1e-2 * max(tally.steps, 200)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(seed=some.integers(0, 2**32 - 1), number=some.integers(0, 2**16))
def test_a_leg_follows_from_its_seed_and_number(seed, number):
    one, other = draw(seed, number), draw(seed, number)
    assert one.scenario == other.scenario
    assert one.environments == other.environments
    np.testing.assert_array_equal(one.actions(), other.actions())
    assert Scenario.from_json(one.scenario.to_json()) == one.scenario


def test_a_soak_sees_what_it_looks_for(monkeypatch):
    """A number that is not finite, a covariance that is not positive definite, an exception, and repairs."""
    leg = next(leg for leg in (draw(0, number, most=8) for number in range(50)) if leg.scenario.action_size)

    def told(method, spoil):
        lines, found = [], getattr(LocalisationVectorEnv, method)
        with monkeypatch.context() as patch:
            patch.setattr(LocalisationVectorEnv, method, lambda env, *a, **k: spoil(env, found(env, *a, **k)))
            tally = fly_leg(draw(0, leg.number, most=8), 1, lines.append)
        return tally, lines

    def spoil_observation(env, result):
        result[0][0, 0] = np.nan
        return result

    def spoil_covariance(env, result):
        env.batch.tiles[0].track.covariance[0, 0, 0] = -1.0
        return result

    def repair(env, result):
        result[4]["repairs"][0] += 3
        return result

    def fail(env, result):
        raise RuntimeError("as wanted")

    assert told("step", spoil_observation)[1] == ["1 times a number is not finite"]
    assert told("step", spoil_covariance)[1] == ["1 covariances are not positive definite"]
    assert told("step", fail)[1] == ["RuntimeError: as wanted"]
    tally, lines = told("step", repair)
    assert (tally.repairs, lines) == (3, [])


def final_observation(env, observation, info):
    """Of the first episode that has just ended."""
    ended = info.get("_final_obs", np.zeros(1, bool))
    return info["final_obs"][ended.argmax()] if ended.any() else None


def final(name):
    """What the last info of episodes says."""
    return lambda env, observation, info: info["final_info"][name] if "final_info" in info else None


PLANTED = {
    "the first observation": ("reset", lambda env, observation, info: observation, "not finite"),
    "the first info": ("reset", lambda env, observation, info: info["nees"], "not finite"),
    "the first belief": ("reset", lambda env, observation, info: env.batch.tiles[0].track.mean, "not finite"),
    "the last observation": ("step", final_observation, "not finite"),
    "the last info": ("step", final("nees"), "not finite"),
    "the last covariance": ("step", final("covariance"), "not positive definite"),
}


@pytest.mark.parametrize("where", PLANTED)
def test_a_soak_judges_first_and_last_states(where, monkeypatch):
    """Where finished environments begin anew in the same step, nobody else sees how their episodes ended."""
    method, find, expected = PLANTED[where]
    leg = next(leg for leg in (draw(0, number, most=8) for number in range(50)) if leg.mode == "SameStep")
    found, lines = getattr(LocalisationVectorEnv, method), []

    def spoilt(env, *args, **keywords):
        result = found(env, *args, **keywords)
        array = find(env, result[0], result[-1])
        if array is not None:
            array[...] = np.nan
        return result

    steps = leg.environments * leg.scenario.episode.steps
    assert fly_leg(draw(0, leg.number, most=8), steps, lines.append).sound
    monkeypatch.setattr(LocalisationVectorEnv, method, spoilt)
    fly_leg(leg, steps, lines.append)
    assert any(expected in line for line in lines)
