"""Mistakes of a caller: one clear line that says what is allowed, and nothing has changed."""

import copy

import gymnasium
import numpy as np
import pytest

from passloc_env import ActionError, LocalisationEnv, LocalisationVectorEnv, NotResetError, ScenarioError

SIZE = 3


@pytest.fixture
def assert_refused(assert_same):
    """Calls that must raise one line and leave the environment exactly as it was, also for what it does next."""

    def check(env, call, kind, message):
        twin, before = copy.deepcopy(env), env.get_state()
        with pytest.raises(kind, match=message) as raised:
            call()
        assert "\n" not in str(raised.value)
        assert_same(env.get_state(), before)
        assert_same(env.reset(), twin.reset())
        action = np.full(env.action_space.shape, 0.25, np.float32)
        assert_same(env.step(action), twin.step(action))

    return check


@pytest.fixture
def scalar(short):
    env = LocalisationEnv(overrides=short("BearingsOnly"), diagnostics=True)
    env.reset(seed=1)
    env.step(np.zeros(1, np.float32))
    return env


@pytest.fixture
def vector(vector_env):
    env = vector_env(SIZE)
    env.reset(seed=1)
    env.step(np.zeros((SIZE, 1), np.float32))
    return env


@pytest.fixture
def finished(vector_env, actions):
    """In mode Disabled, with at least one of its episodes over and at least one not."""
    env = vector_env(SIZE, mode="Disabled")
    env.reset(seed=1)
    stream = actions(SIZE)
    for _ in range(40):
        _, _, terminated, truncated, _ = env.step(next(stream))
        ended = terminated | truncated
        if ended.any() and not ended.all():
            return env, ended
        if ended.any():
            env.reset(options={"reset_mask": ended})
    raise AssertionError("all episodes end at once")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_action_not_finite(bad, scalar, vector, assert_refused):
    assert_refused(scalar, lambda: scalar.step(np.array([bad])), ActionError, "NaN or infinite")
    action = np.zeros((SIZE, 1))
    action[1] = bad
    assert_refused(vector, lambda: vector.step(action), ActionError, r"\[1\] are NaN or infinite")


@pytest.mark.parametrize("shape", [(), (0,), (2,), (1, 1)])
def test_scalar_action_of_wrong_shape(shape, scalar, assert_refused):
    assert_refused(scalar, lambda: scalar.step(np.zeros(shape)), ActionError, r"expected \(1,\)")


@pytest.mark.parametrize("shape", [(), (SIZE,), (SIZE, 2), (1, SIZE), (SIZE + 1, 1), (SIZE, 1, 1)])
def test_vector_action_of_wrong_shape(shape, vector, assert_refused):
    assert_refused(vector, lambda: vector.step(np.zeros(shape)), ActionError, r"expected \(3, 1\)")


@pytest.mark.parametrize("word", ["left", None, {}, object()])
def test_action_of_wrong_type(word, scalar, vector, assert_refused):
    assert_refused(scalar, lambda: scalar.step([word]), ActionError, "numbers of shape|NaN")
    assert_refused(vector, lambda: vector.step([[word]] * SIZE), ActionError, r"numbers of shape \(3, 1\)|NaN")


def test_action_array_of_wrong_type(vector, assert_refused):
    words = np.full((SIZE, 1), "left")
    assert_refused(vector, lambda: vector.step(words), ActionError, r"numbers of shape \(3, 1\)")


def test_ragged_actions(scalar, vector, assert_refused):
    assert_refused(vector, lambda: vector.step([[0.0], [0.0, 1.0], [0.0]]), ActionError, r"shape \(3, 1\)")
    assert_refused(scalar, lambda: scalar.step([[0.0], [0.0, 1.0]]), ActionError, r"\(1,\)")


def test_complex_actions(scalar, vector, assert_refused):
    assert_refused(vector, lambda: vector.step(np.full((SIZE, 1), 0.5j)), ActionError, r"shape \(3, 1\)")
    assert_refused(scalar, lambda: scalar.step([0.5j]), ActionError, "numbers of shape")


@pytest.mark.parametrize("value", [0, 0.5, np.float16(0.5), np.int64(-1), 1e30, -1e300])
def test_any_finite_number_flies(value, scalar, vector):
    observation, reward, *_ = scalar.step([value])
    assert np.isfinite(observation).all()
    assert np.isfinite(reward)
    limit = float(np.clip(float(value), -1, 1))
    assert observation[-1] == np.float32(limit)
    assert np.isfinite(vector.step([[value]] * SIZE)[1]).all()


def test_step_before_reset_of_a_scalar():
    env = LocalisationEnv()
    with pytest.raises(NotResetError, match=r"^no episode is running: call reset\(\) first$"):
        env.step(np.zeros(1))
    assert env.reset(seed=2)[0].tobytes() == LocalisationEnv().reset(seed=2)[0].tobytes()


def test_step_before_reset_of_a_vector(vector_env):
    env = vector_env(SIZE)
    with pytest.raises(NotResetError, match=r"before reset: call reset\(\) first$"):
        env.step(np.zeros((SIZE, 1)))
    assert env.reset(seed=2)[0].tobytes() == vector_env(SIZE).reset(seed=2)[0].tobytes()


def test_step_before_all_have_been_reset(vector_env):
    env, seeds = vector_env(SIZE), [5, 6, 7]
    env.reset(seed=seeds, options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(NotResetError, match=r"before reset: call reset\(\) first$"):
        env.step(np.zeros((SIZE, 1)))
    observation, _ = env.reset(seed=seeds, options={"reset_mask": np.array([False, True, False])})
    assert observation.tobytes() == vector_env(SIZE).reset(seed=seeds)[0].tobytes()
    assert np.isfinite(env.step(np.zeros((SIZE, 1)))[1]).all()


def test_step_after_the_end_of_a_scalar(short, assert_refused):
    env = LocalisationEnv(overrides=short("BearingsOnly"), diagnostics=True)
    env.reset(seed=1)
    for _ in range(4):
        *_, terminated, truncated, _ = env.step(np.ones(1))
        if terminated or truncated:
            break
    assert terminated or truncated
    assert_refused(env, lambda: env.step(np.zeros(1)), NotResetError, r"^no episode is running: call reset\(\) first$")


def test_step_after_the_end_when_disabled(finished, assert_refused):
    env, ended = finished
    names = str(np.flatnonzero(ended).tolist()).replace("[", r"\[").replace("]", r"\]")
    assert_refused(
        env, lambda: env.step(np.zeros((SIZE, 1))), NotResetError, f"environments {names} have finished: .*reset_mask"
    )


@pytest.mark.parametrize("seed", [[], [1], [1, 2], [1, 2, 3, 4]])
def test_seeds_of_wrong_length(seed, vector, assert_refused):
    message = f"seed has length {len(seed)}, expected one for each of {SIZE} environments"
    assert_refused(vector, lambda: vector.reset(seed=seed), ValueError, message)


@pytest.mark.parametrize("seed", [-1, 1.5, "abc", [1, -1, 2], [1, "x", 2], [1, 2.5, 3]])
def test_impossible_seeds_of_a_vector(seed, vector, assert_refused):
    assert_refused(vector, lambda: vector.reset(seed=seed), (ValueError, gymnasium.error.Error), "(?i)^seed")


@pytest.mark.parametrize("seed", [-1, 1.5, "abc", [1]])
def test_impossible_seeds_of_a_scalar(seed, scalar, assert_refused):
    assert_refused(scalar, lambda: scalar.reset(seed=seed), (ValueError, gymnasium.error.Error), "(?i)^seed")


@pytest.mark.parametrize(
    "mask",
    [
        [True, False, True],
        np.array([1, 0, 1]),
        np.array([True, False]),
        np.ones((SIZE, 1), bool),
        np.array(True),
        None,
        "all",
        np.zeros(SIZE, bool),
    ],
    ids=["list", "integers", "too short", "column", "no axis", "none", "word", "false everywhere"],
)
def test_bad_reset_mask(mask, finished, assert_same):
    env, _ = finished
    before, options = env.get_state(), {"reset_mask": copy.deepcopy(mask)}
    with pytest.raises(ValueError, match=r"^reset_mask .*must ") as raised:
        env.reset(seed=3, options=options)
    assert "\n" not in str(raised.value)
    assert_same(options, {"reset_mask": mask})
    assert_same(env.get_state(), before)


def test_bad_reset_mask_of_a_scalar(scalar, assert_refused):
    options = {"reset_mask": np.zeros(2, bool)}
    assert_refused(scalar, lambda: scalar.reset(seed=7, options=options), ValueError, "^reset_mask must be ")


def test_good_reset_mask_is_left_alone(finished, assert_same):
    env, ended = finished
    options = {"reset_mask": ended.copy()}
    old, _ = env.reset(options=options)
    assert options.keys() == {"reset_mask"}
    assert_same(options["reset_mask"], ended)
    again, info = env.reset(options={"reset_mask": ended}, seed=[5, 6, 7])
    assert_same(again[~ended], old[~ended])
    assert not (again[ended] == old[ended]).all(axis=1).any()
    assert_same(info["_violated"], ended)


def test_unknown_option(scalar, vector, assert_refused):
    message = "no such reset option; did you mean 'reset_mask'"
    assert_refused(vector, lambda: vector.reset(options={"reset_masks": None}), ScenarioError, message)
    assert_refused(vector, lambda: vector.reset(seed=7, options={"reset_masks": None}), ScenarioError, message)
    assert_refused(scalar, lambda: scalar.reset(options={"start": 1}), ScenarioError, "no such reset option; known: ")


def test_unknown_option_does_not_seed_a_scalar(scalar, assert_refused):
    assert_refused(scalar, lambda: scalar.reset(seed=7, options={"start": 1}), ScenarioError, "no such reset option")


@pytest.mark.parametrize("mode", ["SameStepp", "next_step", None, 3])
def test_unknown_autoreset_mode(mode):
    with pytest.raises(ValueError, match=r"known: Disabled, NextStep, SameStep$"):
        LocalisationVectorEnv(2, autoreset_mode=mode)


@pytest.mark.parametrize("num_envs", [0, -3, 2.0, "2", None, True])
def test_impossible_number_of_environments(num_envs):
    with pytest.raises(ValueError, match=r"^num_envs = .* must be a whole number of at least 1$"):
        LocalisationVectorEnv(num_envs)


@pytest.mark.parametrize("scenario", ["Nowhere", 3, None, {"nmae": "x"}, {"sensors": []}])
@pytest.mark.parametrize("kind", [LocalisationEnv, lambda scenario: LocalisationVectorEnv(2, scenario)])
def test_impossible_scenario(kind, scenario):
    with pytest.raises(ScenarioError, match="is not possible: ") as raised:
        kind(scenario)
    assert "\n" not in str(raised.value)
