"""Actions by choice: what the learner is offered, and what the agent that learnt it picks."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from gymnasium import spaces

from agents import AgentFile, LearnedPolicy
from agents.agent_file import AgentFileError
from agents.learned import choices_of
from passloc_env import SCENARIOS, observation_names
from passloc_env.sb3 import make_vec_env
from training.hyperparameters import HyperparameterError, Hyperparameters
from training.learner import agent_of, build_ppo, learning_env
from training.run_folder import Assignment
from training.train import run
from training.wrappers import Choosing

SCENARIO = SCENARIOS["BearingsOnly"].override({"episode.steps": 40})
SHIPS = SCENARIOS["CrossFix"]
"""Three headings at once."""


pytestmark = pytest.mark.usefixtures("logs_of_its_own")


@pytest.mark.parametrize("count", [2, 3, 24, 32])
def test_choices_are_even_around_the_circle_and_know_no_side(count):
    values = choices_of(count).astype(float)
    assert len(values) == count
    np.testing.assert_allclose(np.diff([*values, values[0] + 2.0]), 2.0 / count, rtol=0, atol=1e-6)
    np.testing.assert_allclose(values, -values[::-1], rtol=0, atol=1e-7)
    assert np.abs(values).max() < 1.0


def test_what_is_chosen_is_flown():
    env, world = Choosing(make_vec_env(SHIPS, 4, seed=0), 5), make_vec_env(SHIPS, 4, seed=0)
    assert env.action_space == spaces.MultiDiscrete([5, 5, 5])
    np.testing.assert_array_equal(env.reset(), world.reset())
    chosen = np.array([[0, 1, 2], [4, 3, 2], [2, 2, 2], [1, 0, 4]])
    values = np.array([-0.8, -0.4, 0.0, 0.4, 0.8], np.float32)
    found, expected = env.step(chosen), world.step(values[chosen])
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_the_agent_picks_what_the_model_holds_likeliest():
    """In every component for itself; that NumPy's argmax is SB3's mode."""
    parameters = Hyperparameters(environments=4, rollout=4, batch_size=4, network=(8,), choices=5)
    model = build_ppo(learning_env(SHIPS, parameters, seed=0), parameters, seed=3)
    policy = LearnedPolicy(agent_of(model, Assignment(SHIPS, parameters, 3, {}), 1.0))
    observation = np.random.default_rng(0).normal(size=(200, len(observation_names(SHIPS)))).astype(np.float32)
    indices, _ = model.predict(observation, deterministic=True)
    found = policy.act(observation, None, None)
    np.testing.assert_array_equal(found, choices_of(5)[indices])
    assert all(len(np.unique(found[:, component])) > 1 for component in range(3))


def test_a_run_that_chooses_is_read_again_and_fits_its_scenario(tmp_path):
    parameters = Hyperparameters(
        decisions=64, environments=4, rollout=8, batch_size=16, epochs=1, network=(8,), choices=6
    )
    run(SHIPS, parameters, tmp_path, 0, quiet=True)
    policy = LearnedPolicy.load(tmp_path, SHIPS)
    assert policy.agent.card["choices"] == 6
    assert (policy.agent.card["architecture"]["actor"][-1], policy.agent.actions) == (18, 3)
    with pytest.raises(AgentFileError, match="which are not the same"):
        LearnedPolicy.load(tmp_path, SCENARIO)


def test_a_number_of_actions_that_does_not_fit_is_refused(tmp_path):
    """Six outputs are three actions of two choices, not one."""
    features = len(observation_names(SCENARIO))
    weights = {"actor.0.weight": np.zeros((6, features), np.float32), "actor.0.bias": np.zeros(6, np.float32)}
    card = {
        "architecture": {"actor": [features, 6]},
        "choices": 2,
        "observation": list(observation_names(SCENARIO)),
        "scenario": SCENARIO.to_dict(),
    }
    AgentFile(weights, card).save(tmp_path)
    with pytest.raises(AgentFileError, match="chooses 3 actions; BearingsOnly takes 1"):
        LearnedPolicy.load(tmp_path, SCENARIO)


@pytest.mark.parametrize("choices", [1, -2, 2.0, "8", True])
def test_impossible_choices_are_refused(choices):
    with pytest.raises(HyperparameterError, match=r"choices = .* 0 or a whole number of at least 2"):
        dataclasses.replace(Hyperparameters(), choices=choices)
