"""Agents as Stable-Baselines3 flies its models: ``predict`` decides as ``act`` does, alone and in batches."""

import warnings

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv

import agents
from passloc_env import LocalisationVectorEnv, observation_names
from passloc_env.errors import InputError
from passloc_env.sb3 import make_vec_env

SHIELDED, BARE = "BearingsOnly", "RadialAcceleration"
CLOSE = {"target.start.range": 13e3}
"""So near the minimum range of 10 km that the shield has to replace actions."""
ENVIRONMENTS, SEED = 4, 3


def close_to(name):
    """What brings an agent's emitter so near that a shield is needed; nothing for those without one."""
    return CLOSE if name == SHIELDED else {}


@pytest.mark.parametrize("name", [SHIELDED, BARE])
def test_sb3_judges_an_agent_by_what_it_would_do(name, monkeypatch):
    """Every action of ``evaluate_policy``, and the returns, against a loop with ``act`` on the same episodes."""
    env = make_vec_env(name, ENVIRONMENTS, seed=SEED, overrides=close_to(name))
    flown = []
    step = env.step_async
    monkeypatch.setattr(env, "step_async", lambda actions: flown.append(actions.copy()) or step(actions))
    agent = agents.load(name).with_belief_of(env)
    returns, lengths = evaluate_policy(agent, env, ENVIRONMENTS, return_episode_rewards=True, warn=False)
    twin = make_vec_env(name, ENVIRONMENTS, seed=SEED, overrides=close_to(name))
    observation, expected = twin.reset(), []
    for actions in flown:
        np.testing.assert_array_equal(actions, agents.load(name).act(observation, twin.belief, None))
        observation, _, _, infos = twin.step(actions)
        expected += [(info["episode"]["r"], info["episode"]["l"]) for info in infos if "episode" in info]
    # SB3 sums rewards of float32 in another order: a part in a million of returns of order one hundred.
    found = zip(returns, lengths, strict=True)
    assert len(expected) == ENVIRONMENTS
    np.testing.assert_allclose(sorted(found), sorted(expected), rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", [SHIELDED, BARE])
def test_a_plain_loop_flies_it_too(name):
    env = gym.make(f"passloc/{name}-v0", overrides=close_to(name))
    agent, unbound = agents.load(name).with_belief_of(env), agents.load(name)
    observation, _ = env.reset(seed=SEED)
    replaced, done = 0, False
    while not done:
        action, state = agent.predict(observation, deterministic=True)
        assert state is None
        assert action.shape == env.action_space.shape
        np.testing.assert_array_equal(action, unbound.act(observation[None], env.unwrapped.belief, None)[0])
        replaced += not np.array_equal(action, unbound.act(observation[None], None, None)[0])
        observation, _, terminated, truncated, _ = env.step(action)
        done = terminated or truncated
    assert (replaced > 0) == (name == SHIELDED)


def test_the_action_is_the_same_whatever_sb3_hands_over():
    agent = agents.load(BARE)
    features = len(observation_names(agent.agent.scenario))
    batch = np.random.default_rng(0).uniform(-1.0, 1.0, (5, features)).astype(np.float32)
    expected = agent.act(batch, None, None)
    for words in ({}, {"deterministic": False}, {"state": None, "episode_start": np.ones(5, bool)}):
        actions, state = agent.predict(batch, **words)
        np.testing.assert_array_equal(actions, expected)
        assert state is None


def test_flying_without_the_shield_is_said():
    features = np.zeros(len(observation_names(agents.load(SHIELDED).agent.scenario)), np.float32)
    with pytest.warns(UserWarning, match=r"learned BearingsOnly flies without its shield.*with_belief_of"):
        agents.load(SHIELDED).predict(features)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        agents.load(BARE).predict(np.zeros(len(observation_names(agents.load(BARE).agent.scenario))))


@pytest.mark.parametrize(
    ("observation", "found"),
    [
        (np.zeros(()), "of shape ()"),
        (np.zeros(3), "of shape (3,)"),
        (np.zeros((2, 3)), "of shape (2, 3)"),
        (np.zeros((1, 1, 15)), "of shape (1, 1, 15)"),
        ({"observation": np.zeros(15)}, "a dict"),
        ([[0.0], [0.0, 1.0]], "a list"),
        ("nothing", "a str"),
    ],
)
def test_an_observation_of_another_shape_is_one_line(observation, found):
    agent = agents.load(SHIELDED)
    features = len(observation_names(agent.agent.scenario))
    with pytest.raises(InputError) as caught:
        agent.predict(observation)
    wanted = f"must be of shape ({features},) or (N, {features}), as BearingsOnly returns it"
    assert str(caught.value) == f"observation is {found}: {wanted}"


def test_belief_and_observation_must_be_of_as_many_environments():
    env = LocalisationVectorEnv(3, SHIELDED)
    observation, _ = env.reset(seed=SEED)
    agent = agents.load(SHIELDED).with_belief_of(env)
    assert agent.predict(observation)[0].shape == (3, 1)
    with pytest.raises(InputError, match="observation has N = 1: the environment's belief has N = 3"):
        agent.predict(observation[0])


@pytest.mark.parametrize(
    "make", [lambda: gym.make("CartPole-v1"), lambda: DummyVecEnv([lambda: gym.make("CartPole-v1")])]
)
def test_an_environment_without_a_belief_is_one_line(make):
    with pytest.raises(InputError, match=r"env = \w+ is not possible: must be an environment of passloc"):
        agents.load(SHIELDED).with_belief_of(make())
