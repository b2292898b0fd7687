"""A snapshot of a batch brings it back bit for bit."""

import copy

import pytest

from passloc_env import SCENARIOS, LocalisationEnv
from passloc_env.batch import TILE

MODES = ["NextStep", "SameStep", "Disabled"]


def fly(env, actions):
    """Results of a few decisions; in mode Disabled with the resets that it asks for."""
    results = []
    for action in actions:
        results.append(env.step(action))
        ended = results[-1][2] | results[-1][3]
        if env.autoreset_mode.value == "Disabled" and ended.any():
            results.append(env.reset(options={"reset_mask": ended}))
    return results


def some(stream, count):
    return [next(stream) for _ in range(count)]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", SCENARIOS)
def test_vector_goes_back(name, mode, vector_env, actions, assert_same):
    env = vector_env(3, name, mode)
    env.reset(seed=1)
    stream = actions(3, env.scenario.action_size)
    fly(env, some(stream, 2))
    state, later = env.get_state(), some(stream, 9)
    expected, end = fly(env, later), env.get_state()
    assert sum((result[2] | result[3]).sum() for result in expected if len(result) == 5) >= 3

    env.set_state(state)
    assert_same(env.get_state(), state)
    assert_same(fly(env, later), expected)
    assert_same(env.get_state(), end)

    other = vector_env(3, name, mode)
    other.reset(seed=99)
    fly(other, some(stream, 3))
    other.set_state(state)
    assert_same(fly(other, later), expected)

    unborn = vector_env(3, name, mode)
    unborn.set_state(state)
    assert_same(fly(unborn, later), expected)


def test_every_tracker_goes_back(tracker, vector_env, actions, assert_same):
    """Into the same environment and into one that has never flown."""
    changes = {"tracker": tracker, "sensors.0.detection_probability": 0.6}
    env, unborn = (vector_env(3, "BearingDoppler", "SameStep", **changes) for _ in range(2))
    env.reset(seed=1)
    stream = actions(3)
    fly(env, some(stream, 2))
    state, later = env.get_state(), some(stream, 6)
    expected, end = fly(env, later), env.get_state()
    for place in (env, unborn):
        place.set_state(state)
        assert_same(fly(place, later), expected)
        assert_same(place.get_state(), end)


@pytest.mark.parametrize("name", SCENARIOS)
def test_scalar_goes_back(name, short, actions, assert_same):
    first, second = (LocalisationEnv(name, overrides=short(name), diagnostics=True) for _ in range(2))
    first.reset(seed=1)
    stream = actions(1, first.scenario.action_size)
    first.step(next(stream)[0])
    state, later = first.get_state(), [action[0] for action in some(stream, 3)]

    def run(env):
        return [env.step(later[0]), env.reset(), env.step(later[1]), env.reset(), env.step(later[2])]

    expected = run(first)
    first.set_state(state)
    assert_same(run(first), expected)
    second.set_state(state)
    assert_same(run(second), expected)


@pytest.mark.parametrize("field", ["sensors.0.sigma", "tracker.motion.acceleration_noise", "platforms.0.speed"])
def test_random_numbers_go_back(field, vector_env, actions, assert_same):
    """Matrices are built from some numbers ahead of time; they follow them back."""
    changes = {field: {"type": "LogUniform", "low": 0.01, "high": 1.0}}
    env, other = (vector_env(3, mode="SameStep", **changes) for _ in range(2))
    env.reset(seed=1)
    other.reset(seed=50)
    stream = actions(3)
    env.step(next(stream))
    state, later = env.get_state(), some(stream, 9)
    expected = fly(env, later)
    for place in (env, other):
        place.set_state(state)
        assert_same(fly(place, later), expected)


def test_everything_seen_goes_back(vector_env, actions, assert_same):
    env, stream = vector_env(3, "BearingDopplerUnknownCarrier"), actions(3)
    env.reset(seed=1)
    env.step(next(stream))
    state, belief = env.get_state(), copy.deepcopy(env.belief)
    simulation = env.batch.tiles[0]
    bound, nees = simulation.outcome.range_sigma.copy(), simulation.outcome.nees.copy()
    env.step(next(stream))
    env.set_state(state)
    for key in ("time", "time_left", "mean", "covariance", "last_action", "offset"):
        assert_same(getattr(env.belief, key), getattr(belief, key), key)
    assert_same(env.belief.poses[0].heading.copy(), belief.poses[0].heading.copy())
    assert_same(simulation.outcome.range_sigma, bound)
    assert_same(simulation.outcome.nees, nees)


def test_snapshot_is_a_copy(vector_env, actions, assert_same):
    env, stream = vector_env(3), actions(3)
    env.reset(seed=1)
    state = env.get_state()
    kept = copy.deepcopy(state)
    for _ in range(6):
        env.step(next(stream))
    assert_same(state, kept)
    env.set_state(state)
    for _ in range(6):
        env.step(next(stream))
    assert_same(state, kept)


def test_state_crosses_tiles(vector_env, actions, assert_same):
    env, stream = vector_env(TILE + 3, mode="SameStep"), actions(TILE + 3)
    env.reset(seed=1)
    env.step(next(stream))
    state, later = env.get_state(), some(stream, 4)
    expected = fly(env, later)
    env.set_state(state)
    assert_same(fly(env, later), expected)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"num_envs": 2}, "the state holds 2 environments, expected 3"),
        ({"name": "BearingDoppler"}, "the state does not fit this environment: "),
        ({"name": "BearingDopplerUnknownCarrier"}, "the state does not fit this environment: "),
        ({"episode.steps": 20}, "the state does not fit this environment: noise.measurement is "),
    ],
)
def test_misfit_is_refused(other, message, vector_env, actions, assert_same):
    env, stream = vector_env(3), actions(3)
    stranger = vector_env(**{"num_envs": 3, **other})
    env.reset(seed=1)
    stranger.reset(seed=2)
    env.step(next(stream))
    before, twin = env.get_state(), copy.deepcopy(env)
    with pytest.raises(ValueError, match=f"^{message}") as raised:
        env.set_state(stranger.get_state())
    assert "\n" not in str(raised.value)
    assert_same(env.get_state(), before)
    later = some(stream, 5)
    assert_same(fly(env, later), fly(twin, later))


@pytest.mark.parametrize("missing", ["arrays", "generators", "ended", "started"])
def test_incomplete_state_is_refused(missing, vector_env, assert_same):
    env, donor = vector_env(3), vector_env(3)
    env.reset(seed=1)
    donor.reset(seed=2)
    state, before = donor.get_state(), env.get_state()
    del state[missing]
    with pytest.raises((ValueError, KeyError), match=missing):
        env.set_state(state)
    assert_same(env.get_state(), before)
