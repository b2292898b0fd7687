"""Gymnasium's own wrappers work around both environments."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers
from gymnasium.wrappers import vector as vector_wrappers

from passloc_env import LocalisationEnv

F = np.float32
SIZE = 3
FEATURES = LocalisationEnv().observation_space.shape[0]
MODES = ["NextStep", "SameStep"]


@pytest.fixture
def both(vector_env):
    """Two equal vector environments."""
    return lambda mode: (vector_env(SIZE, mode=mode), vector_env(SIZE, mode=mode))


def fly(envs, stream, decisions=12):
    """Results of the same actions in each environment, decision by decision."""
    for env in envs:
        env.reset(seed=1)
    for _ in range(decisions):
        action = next(stream)
        yield [env.step(action) for env in envs]


@pytest.mark.parametrize("mode", MODES)
def test_vector_episode_statistics(mode, both, actions):
    plain, other = both(mode)
    wrapped = vector_wrappers.RecordEpisodeStatistics(other)
    total, length, running, counted = np.zeros(SIZE), np.zeros(SIZE, int), np.ones(SIZE, bool), 0
    for ours, theirs in fly([plain, wrapped], actions(SIZE)):
        total[running] += ours[1][running]
        length[running] += 1
        ended = ours[2] | ours[3]
        assert ("episode" in theirs[4]) == ended.any()
        if ended.any():
            statistics = theirs[4]["episode"]
            assert theirs[4]["_episode"].tolist() == ended.tolist()
            assert statistics["r"][ended] == pytest.approx(total[ended], rel=1e-6)
            assert statistics["l"][ended].tolist() == length[ended].tolist()
            counted += ended.sum()
        if mode == "NextStep":
            running = ~ended
        total[ended], length[ended] = 0.0, 0
    assert counted == wrapped.episode_count >= SIZE


def test_vector_episode_statistics_when_disabled(vector_env, actions):
    env, stream = vector_wrappers.RecordEpisodeStatistics(vector_env(SIZE, mode="Disabled")), actions(SIZE)
    env.reset(seed=1)
    for _ in range(12):
        _, _, terminated, truncated, info = env.step(next(stream))
        ended = terminated | truncated
        if ended.any():
            assert (info["episode"]["l"][ended] <= 4).all()
            env.reset(options={"reset_mask": ended})
    assert env.episode_count >= SIZE


OBSERVATION_WRAPPERS = {
    "flatten": (vector_wrappers.FlattenObservation, lambda x: x),
    "reshape": (lambda env: vector_wrappers.ReshapeObservation(env, (FEATURES, 1)), lambda x: x[..., None]),
    "rescale": (
        lambda env: vector_wrappers.RescaleObservation(env, np.full(FEATURES, -1, F), np.full(FEATURES, 1, F)),
        lambda x: x / 10,
    ),
    "transform": (lambda env: vector_wrappers.TransformObservation(env, np.negative), np.negative),
}


# Gymnasium refuses to wrap observations in mode SameStep.
@pytest.mark.parametrize(("wrap", "expected"), OBSERVATION_WRAPPERS.values(), ids=list(OBSERVATION_WRAPPERS))
def test_vector_observation_wrappers(wrap, expected, both, actions):
    plain, other = both("NextStep")
    wrapped, ends = wrap(other), 0
    for ours, theirs in fly([plain, wrapped], actions(SIZE)):
        np.testing.assert_allclose(theirs[0], expected(ours[0]), atol=1e-6)
        assert theirs[0].dtype == wrapped.observation_space.dtype
        assert theirs[0].shape == wrapped.observation_space.shape
        ends += (ours[2] | ours[3]).sum()
    assert ends >= SIZE


def test_vector_normalisation(both, actions):
    plain, other = both("NextStep")
    observations = vector_wrappers.NormalizeObservation(other)
    wrapped = vector_wrappers.NormalizeReward(observations)
    seen = [plain.reset(seed=1)[0]]
    for ours, theirs in fly([plain, wrapped], actions(SIZE)):
        seen.append(ours[0])
        assert np.isfinite(theirs[0]).all()
        assert np.isfinite(theirs[1]).all()
        assert (np.sign(theirs[1]) == np.sign(ours[1])).all()
    np.testing.assert_allclose(observations.obs_rms.mean, np.concatenate(seen).mean(axis=0), atol=1e-3)


REWARD_WRAPPERS = {
    "clip": (lambda env: vector_wrappers.ClipReward(env, -0.1, 0.1), lambda x: np.clip(x, -0.1, 0.1)),
    "transform": (lambda env: vector_wrappers.TransformReward(env, lambda x: 2 * x), lambda x: 2 * x),
}


@pytest.mark.parametrize(("wrap", "expected"), REWARD_WRAPPERS.values(), ids=list(REWARD_WRAPPERS))
def test_vector_reward_wrappers(wrap, expected, both, actions):
    plain, other = both("NextStep")
    rewards = [(ours[1], theirs[1]) for ours, theirs in fly([plain, wrap(other)], actions(SIZE))]
    for ours, theirs in rewards:
        np.testing.assert_allclose(theirs, expected(ours))
    assert any((ours != theirs).any() for ours, theirs in rewards)


def test_vector_clip_action(both, actions):
    plain, other = both("NextStep")
    for ours, theirs in fly([plain, vector_wrappers.ClipAction(other)], (2 * action for action in actions(SIZE))):
        assert (theirs[1] == ours[1]).all()


def test_vector_rescale_action(both, actions):
    plain, other = both("NextStep")
    wrapped = vector_wrappers.RescaleAction(other, np.zeros(1, F), np.full(1, 2, F))
    plain.reset(seed=1)
    wrapped.reset(seed=1)
    for action in [next(actions(SIZE)) for _ in range(6)]:
        ours, theirs = plain.step(action), wrapped.step(action + 1)
        np.testing.assert_allclose(theirs[1], ours[1], rtol=1e-4)


def test_vector_info_as_list(vector_env, actions):
    env, stream = vector_wrappers.DictInfoToList(vector_env(SIZE, mode="SameStep")), actions(SIZE)
    _, infos = env.reset(seed=1)
    assert [set(info["reward_terms"]) for info in infos] == [
        {"range_bound", "gram_gain", "tracking_error", "keep_out"}
    ] * 3
    finals = 0
    for _ in range(6):
        _, _, terminated, truncated, infos = env.step(next(stream))
        assert ["final_info" in info for info in infos] == (terminated | truncated).tolist()
        finals += sum("final_info" in info for info in infos)
    assert finals >= SIZE


def test_scalar_time_limit():
    env = wrappers.TimeLimit(LocalisationEnv(overrides={"episode.early_end": False}), 5)
    env.reset(seed=0)
    assert [env.step(np.zeros(1, F))[3] for _ in range(5)] == [False] * 4 + [True]


def test_make_with_a_limit_of_its_own():
    env = gymnasium.make("passloc/BearingsOnly-v0", max_episode_steps=3)
    env.reset(seed=0)
    assert [env.step(np.full(1, 0.5, F))[3] for _ in range(3)] == [False, False, True]


def test_scalar_episode_statistics(short):
    env = wrappers.RecordEpisodeStatistics(LocalisationEnv(overrides=short("BearingsOnly")))
    env.reset(seed=0)
    total, done = 0.0, False
    while not done:
        _, reward, terminated, truncated, info = env.step(np.full(1, 0.5, F))
        total, done = total + reward, terminated or truncated
    assert info["episode"]["r"] == pytest.approx(total, rel=1e-6)
    assert 1 <= info["episode"]["l"] <= 4


def test_scalar_frame_stack():
    plain, env = LocalisationEnv(), wrappers.FrameStackObservation(LocalisationEnv(), 3)
    first, _ = plain.reset(seed=0)
    stacked, _ = env.reset(seed=0)
    assert stacked.shape == (3, FEATURES)
    assert (stacked == first).all()
    action = np.full(1, 0.5, F)
    frames = [first, plain.step(action)[0], plain.step(action)[0]]
    env.step(action)
    assert (env.step(action)[0] == np.stack(frames)).all()


def test_scalar_action_wrappers():
    plain = LocalisationEnv()
    clipped = wrappers.ClipAction(LocalisationEnv())
    rescaled = wrappers.RescaleAction(LocalisationEnv(), F(0.0), F(2.0))
    assert rescaled.action_space == spaces.Box(0.0, 2.0, (1,), F)
    for env in (plain, clipped, rescaled):
        env.reset(seed=0)
    expected = plain.step(np.ones(1, F))
    for env, action in ((clipped, 7.0), (rescaled, 2.0)):
        observation, reward, *_ = env.step(np.full(1, action, F))
        assert (observation == expected[0]).all()
        assert reward == expected[1]


@pytest.mark.parametrize(
    "wrap",
    [
        wrappers.NormalizeObservation,
        wrappers.NormalizeReward,
        wrappers.FlattenObservation,
        lambda env: wrappers.TransformReward(env, lambda reward: 2 * reward),
        lambda env: wrappers.ClipReward(env, -1.0, 1.0),
        lambda env: wrappers.TimeAwareObservation(wrappers.TimeLimit(env, 4)),
        lambda env: wrappers.DelayObservation(env, 2),
        lambda env: wrappers.StickyAction(env, 0.5),
        wrappers.PassiveEnvChecker,
        wrappers.OrderEnforcing,
        wrappers.Autoreset,
    ],
)
def test_other_scalar_wrappers_run(wrap, short):
    env = wrap(LocalisationEnv(overrides=short("BearingsOnly")))
    env.reset(seed=0)
    for _ in range(3):
        observation, reward, terminated, truncated, _ = env.step(np.full(1, 0.5, F))
        assert np.isfinite(np.asarray(observation, float)).all()
        assert np.isfinite(reward)
        if terminated or truncated:
            break
