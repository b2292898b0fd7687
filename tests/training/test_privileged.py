"""The critic is told the truth; the actor, and whatever is flown, never is."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.vec_env import DummyVecEnv

from agents.symmetry import MirrorSymmetry
from passloc_env import SCENARIOS, observation_names
from passloc_env.sb3 import make_vec_env
from passloc_env.tracking import InteractingModels
from training.hyperparameters import Hyperparameters
from training.learner import build_ppo, learning_env
from training.privileged import WithTruth, truth_names
from training.train import run

SCENARIO = SCENARIOS["BearingsOnly"].override({"episode.steps": 40})
SEEN = len(observation_names(SCENARIO))
HIDDEN = len(truth_names(SCENARIO))
N = 8
TINY = Hyperparameters(
    decisions=256,
    environments=N,
    rollout=16,
    batch_size=32,
    epochs=1,
    network=(8,),
    mirror=True,
    privileged_critic=True,
)


pytestmark = pytest.mark.usefixtures("logs_of_its_own")


def told(env):
    """The truth's features by name, in the batch after one step."""
    env.seed(1)
    env.reset()
    observation, *_ = env.step(np.full((env.num_envs, env.action_space.shape[0]), 0.3, np.float32))
    batch = env.unwrapped.env.batch
    names = truth_names(batch.scenario)
    return dict(zip(names, observation[:, -len(names) :].T, strict=True)), batch.tiles[0], observation


def test_what_is_told_is_where_the_emitter_is_and_how_well_it_could_be_known():
    features, tile, observation = told(WithTruth(make_vec_env(SCENARIO, N)))
    assert np.array_equal(observation[:, :SEEN], tile.observe().T.astype(np.float32))
    pose = tile.poses()[0]
    offset = tile.truth[:2] - pose.position
    distance = np.hypot(*offset)
    scales = SCENARIO.observation
    assert features["ln range"] == pytest.approx(np.log(distance / scales.range_scale), rel=1e-6)
    closing = (offset / distance * tile.truth[2:4]).sum(axis=0) / scales.speed_scale
    assert features["emitter velocity along"] == pytest.approx(closing, rel=1e-5)
    # The range's deviation in the bound is the one that rewards are made of.
    assert features["ln sigma of position along"] == pytest.approx(
        np.log(tile.outcome.range_sigma / distance), rel=1e-5
    )


def test_the_truth_is_told_in_the_state_of_the_bound():
    """Interacting models estimate accelerations and turn rates, of which the bound knows nothing."""
    scenario = SCENARIOS["BearingDoppler"].override({"tracker": InteractingModels(), "episode.steps": 40})
    features, tile, observation = told(WithTruth(make_vec_env(scenario, N)))
    assert "acceleration along" not in " ".join(features)
    assert observation.shape[1] == len(observation_names(scenario)) + len(features)
    assert np.isfinite(observation).all()
    place, moving = tile.models.truth.layout.position, tile.models.truth.layout.velocity
    offset = tile.truth[place] - tile.poses()[0].position
    closing = (offset * tile.truth[moving]).sum(axis=0) / np.hypot(*offset) / scenario.observation.speed_scale
    assert features["emitter velocity along"] == pytest.approx(closing, rel=1e-5)


def test_the_last_observation_is_as_wide_as_every_other():
    env = WithTruth(make_vec_env(SCENARIO, N, seed=0))
    env.reset()
    for _ in range(10):
        _, _, done, infos = env.step(np.zeros((N, 1), np.float32))
    assert done.all()
    for info in infos:
        assert info["terminal_observation"].shape == env.observation_space.shape
        assert not info["terminal_observation"][SEEN:].any()


def test_a_mirror_shows_the_truth_on_the_same_side():
    """Seen in the mirror the hidden features change as their names say, by the side that the belief is on."""
    plain = WithTruth(make_vec_env(SCENARIO, 64, seed=5))
    mirrored = learning_env(SCENARIO, dataclasses.replace(TINY, environments=64), seed=5)
    before, after = plain.reset(), mirrored.reset()
    names = [*observation_names(SCENARIO), *truth_names(SCENARIO)]
    port = before[:, names.index("own velocity across")] < 0.0
    assert 10 < port.sum() < 54
    parity = MirrorSymmetry(SCENARIO).parity
    assert truth_names(SCENARIO) == observation_names(SCENARIO)
    assert np.array_equal(after[port], before[port] * np.tile(parity, 2))
    assert np.array_equal(after[~port], before[~port])


def test_the_actor_cannot_see_what_the_critic_sees():
    policy = build_ppo(learning_env(SCENARIO, TINY, seed=0), TINY, seed=0).policy
    rng = np.random.default_rng(0)
    seen = rng.normal(size=(5, SEEN)).astype(np.float32)
    views = [torch.as_tensor(np.hstack([seen, rng.normal(size=(5, HIDDEN)).astype(np.float32)])) for _ in range(2)]
    with torch.no_grad():
        actions = [policy(view, deterministic=True)[0] for view in views]
        likelihoods = [policy.evaluate_actions(view, actions[0])[1] for view in views]
        values = [policy.predict_values(view) for view in views]
    assert torch.equal(*actions)
    assert torch.equal(*likelihoods)
    assert not torch.isclose(*values).any()


def test_what_is_flown_sees_the_belief_alone(tmp_path):
    agent = run(SCENARIO, TINY, tmp_path, 0, quiet=True).agent
    assert agent.card["architecture"]["actor"] == [SEEN, 8, 1]
    assert agent.card["observation"] == list(observation_names(SCENARIO))


def test_only_an_environment_of_ours_can_tell_the_truth():
    with pytest.raises(TypeError, match="DummyVecEnv cannot tell the truth"):
        WithTruth(DummyVecEnv([lambda: __import__("gymnasium").make("passloc/BearingsOnly-v0")]))
