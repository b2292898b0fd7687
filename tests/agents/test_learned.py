"""Trained agents: flown as Stable-Baselines3 flies them, and read from files without trusting a byte."""

import hashlib
import importlib.metadata
import io
import json
import pickle
import struct

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from agents import AgentFile, AgentFileError, LearnedPolicy, Policy
from agents.agent_file import CARD, WEIGHTS
from agents.learned import is_agent
from passloc_env import SCENARIOS, LocalisationVectorEnv, observation_names

pytest.importorskip("stable_baselines3")
import torch

from passloc_env.sb3 import make_vec_env
from training.hyperparameters import Hyperparameters
from training.learner import agent_of, build_ppo
from training.provenance import provenance
from training.run_folder import Assignment

SCENARIO = SCENARIOS["BearingsOnly"]
PARAMETERS = Hyperparameters(decisions=8, environments=2, rollout=4, batch_size=4, network=(16, 8))
FEATURES = len(observation_names(SCENARIO))


def untrained(scenario=SCENARIO, seed=0):
    """An untrained PPO, its output layer enlarged so that actions reach their limits, and its agent."""
    model = build_ppo(make_vec_env(scenario, 2, seed=0), PARAMETERS, seed)
    with torch.no_grad():
        model.policy.action_net.weight.mul_(100.0)
        model.policy.action_net.bias.add_(0.1)
    return model, agent_of(model, Assignment(scenario, PARAMETERS, seed, provenance(["test"])), 1.5)


@pytest.fixture(scope="module")
def model_and_agent():
    return untrained()


@pytest.fixture
def folder(model_and_agent, tmp_path):
    model_and_agent[1].save(tmp_path)
    return tmp_path


def edit_card(folder, **changes):
    """Replace entries of the card, or remove those set to None."""
    card = json.loads((folder / CARD).read_text(encoding="utf-8")) | changes
    text = json.dumps({key: value for key, value in card.items() if value is not None})
    (folder / CARD).write_text(text, encoding="utf-8")


def edit_weights(folder, **changes):
    """Replace weights by name, with double underscores for dots, or remove those set to None."""
    weights = load_file(folder / WEIGHTS) | {name.replace("__", "."): value for name, value in changes.items()}
    save_file({name: value for name, value in weights.items() if value is not None}, folder / WEIGHTS)
    edit_card(folder, weights_sha256=None)


def refusal(path, scenario=SCENARIO):
    """The one line with which an agent is refused."""
    with pytest.raises(AgentFileError) as caught:
        LearnedPolicy.load(path, scenario)
    message = str(caught.value)
    assert "\n" not in message
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    return message


@pytest.mark.parametrize("rows", [1, 3, 400])
def test_numpy_actor_equals_sb3(model_and_agent, rows):
    """1e-6: two float32 implementations of the same sums, actions of order one; some of them clipped."""
    model, agent = model_and_agent
    policy = LearnedPolicy(agent)
    observation = np.random.default_rng(rows).uniform(-10.0, 10.0, (rows, FEATURES)).astype(np.float32)
    expected, _ = model.predict(observation, deterministic=True)
    found = policy.act(observation, None, None)
    assert (found.shape, expected.shape) == ((rows, 1), (rows, 1))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    if rows == 400:
        assert 0.1 < np.mean(np.abs(found) == 1.0) < 0.9
        assert 0.1 < np.mean(found < 0.0) < 0.9


def test_it_is_a_policy_and_flies(model_and_agent):
    policy = LearnedPolicy(model_and_agent[1])
    assert isinstance(policy, Policy)
    env = LocalisationVectorEnv(3)
    observation, _ = env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(policy.act(observation, env.belief, np.random.default_rng(0)))
    assert np.isfinite(observation).all()


def test_round_trip(model_and_agent, folder):
    _, agent = model_and_agent
    again = AgentFile.load(folder)
    assert again.weights.keys() == agent.weights.keys()
    for name, array in agent.weights.items():
        assert (again.weights[name].dtype, again.weights[name].tobytes()) == (array.dtype, array.tobytes())
    digest = hashlib.sha256((folder / WEIGHTS).read_bytes()).hexdigest()
    assert again.card == {"format": "passloc-agent-1", **agent.card, "weights_sha256": digest}
    assert again.scenario == SCENARIO
    assert [weight.shape for weight, _ in again.layers] == [(16, FEATURES), (8, 16), (1, 8)]
    assert sorted(path.name for path in folder.iterdir()) == [CARD, WEIGHTS]
    observation = np.ones((2, FEATURES), np.float32)
    loaded = LearnedPolicy.load(folder, SCENARIO).act(observation, None, None)
    assert np.array_equal(loaded, LearnedPolicy(agent).act(observation, None, None))


def test_the_card_says_where_the_agent_comes_from(model_and_agent):
    training = model_and_agent[1].card["training"]
    assert training["hyperparameters"]["network"] == [16, 8]
    assert {"algorithm", "seed", "decisions", "seconds", "command", "versions", "machine"} <= training.keys()
    assert (training["algorithm"], training["seed"], training["seconds"]) == ("PPO", 0, 1.5)
    assert training["versions"]["torch"] == importlib.metadata.version("torch")


def test_saving_replaces_whole_files(folder):
    """An interrupted write leaves the old agent and no half of a new one."""
    agent = AgentFile.load(folder)
    before = (folder / CARD).read_bytes()
    agent.card["scores"] = float("nan")
    with pytest.raises(ValueError, match="JSON"):
        agent.save(folder)
    assert (folder / CARD).read_bytes() == before
    assert AgentFile.load(folder).card.keys() == json.loads(before).keys()


def test_what_is_meant_as_an_agent(tmp_path):
    assert is_agent(tmp_path)
    assert is_agent(tmp_path / "nowhere" / CARD)
    assert is_agent(tmp_path / "nowhere" / WEIGHTS)
    assert not is_agent(tmp_path / "circle")


@pytest.mark.parametrize(("name", "words"), [(CARD, "is not a run folder"), (WEIGHTS, "cannot read")])
def test_a_missing_file(folder, name, words):
    (folder / name).unlink()
    message = refusal(folder)
    assert words in message
    assert name in message


def test_a_missing_folder(tmp_path):
    assert "cannot read" in refusal(tmp_path / "nowhere" / CARD)


@pytest.mark.parametrize("keep", [0, 4, 8, 40, 0.5, -1])
def test_truncated_weights(folder, keep):
    content = (folder / WEIGHTS).read_bytes()
    (folder / WEIGHTS).write_bytes(content[: int(len(content) * keep) if isinstance(keep, float) else keep])
    assert WEIGHTS in refusal(folder)


def test_weights_of_another_kind(folder):
    """A pickle and an archive of arrays under the right name are just not safetensors."""
    buffer = io.BytesIO()
    np.savez(buffer, a=np.zeros(3))
    edit_card(folder, weights_sha256=None)
    for content in (pickle.dumps({"actor.0.weight": [1.0]}), buffer.getvalue(), struct.pack("<Q", 2**60) + b"{}"):
        (folder / WEIGHTS).write_bytes(content)
        assert "not a readable safetensors file" in refusal(folder)


@pytest.mark.parametrize(
    "change",
    [
        {"actor__0__weight": np.zeros((16, FEATURES - 1), np.float32)},
        {"actor__0__weight": np.zeros((FEATURES, 16), np.float32)},
        {"actor__2__bias": np.zeros((), np.float32)},
        {"actor__1__weight": None},
        {"actor__2__bias": None},
        {"actor__3__weight": np.zeros((1, 1), np.float32)},
    ],
)
def test_wrong_shapes(folder, change):
    edit_weights(folder, **change)
    assert "does not hold the actor" in refusal(folder)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["actor.0.weight", "actor.2.bias"])
def test_weights_that_are_not_finite(folder, name, value):
    broken = load_file(folder / WEIGHTS)[name].copy()
    broken.flat[-1] = value
    edit_weights(folder, **{name.replace(".", "__"): broken})
    assert "not finite" in refusal(folder)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'"agent"',
        b"3",
        b"null",
        b"{}",
        b'{"format": "passloc-agent-0"}',
        b'{"format": ["passloc-agent-1"]}',
        b'{"format": "passloc-agent-1"}',
        b"\xff\xfe\x00",
        b"[" * 100_000,
    ],
    ids=["empty", "half", "list", "text", "number", "null", "no format", "old", "wrong type", "bare", "bytes", "deep"],
)
def test_a_card_that_is_none(folder, content):
    (folder / CARD).write_bytes(content)
    assert CARD in refusal(folder)


@pytest.mark.parametrize("format_", ["passloc-agent-2", "", 1, None])
def test_another_format(folder, format_):
    edit_card(folder, format=format_)
    assert "passloc-agent-1" in refusal(folder)


@pytest.mark.parametrize(
    "change",
    [
        {"scenario": None},
        {"scenario": []},
        {"scenario": {"name": 3}},
        {"scenario": {"type": "NoSuchThing"}},
        {"scenario": {"episode": {"steps": -1}}},
        {"architecture": None},
        {"architecture": []},
        {"architecture": {}},
        {"architecture": {"actor": 3}},
        {"architecture": {"actor": [FEATURES, "16", 8, 1]}},
        {"architecture": {"critic": [FEATURES, 16, 8, 1]}},
        {"architecture": {"actor": []}},
        {"architecture": {"actor": [1]}},
        {"architecture": {"actor": [FEATURES, 16, 8, 1], "critic": [FEATURES, 16, 8, 1]}},
        {"choices": 1},
        {"choices": -2},
        {"choices": 2.0},
        {"choices": "2"},
        {"choices": True},
        {"choices": 2},
        {"observation": None},
        {"observation": 3},
        {"observation": []},
        {"observation": [["a"]]},
    ],
    ids=str,
)
def test_a_card_that_does_not_describe_the_agent(folder, change):
    assert refusal_names_a_file(folder, change)


@pytest.mark.parametrize(
    "architecture",
    [
        {},
        {"critic": [FEATURES, 1]},
        {"actor": []},
        {"actor": [1]},
        {"actor": [FEATURES]},
        {"actor": [3, 1]},
    ],
    ids=str,
)
def test_weights_and_card_that_agree_on_nonsense(folder, architecture):
    """Files that fit each other, but hold no actor for the observation they claim to see."""
    weights = {
        f"{network}.0.{kind}": np.zeros((sizes[1], sizes[0]) if kind == "weight" else sizes[1], np.float32)
        for network, sizes in architecture.items()
        for kind in ("weight", "bias")
        if len(sizes) > 1
    }
    save_file(weights, folder / WEIGHTS)
    assert refusal_names_a_file(folder, {"architecture": architecture})
    assert str(folder) in refusal(folder, scenario=None)


def refusal_names_a_file(folder, change):
    edit_card(folder, **change)
    return str(folder) in refusal(folder)


def test_a_card_of_another_observation_space(folder):
    message = refusal(folder, SCENARIOS["BearingDopplerUnknownCarrier"])
    offered = len(observation_names(SCENARIOS["BearingDopplerUnknownCarrier"]))
    assert "BearingsOnly" in message
    assert f"sees {FEATURES} features" in message
    assert f"offers {offered}" in message


def test_the_same_number_of_other_features(folder):
    names = list(observation_names(SCENARIO))
    edit_card(folder, observation=[*names[1:], names[0]])
    assert "not what BearingsOnly offers" in refusal(folder)


def test_another_number_of_actions(folder):
    """The observation is the same; the networks end in two actions."""
    wide = {"actor": [FEATURES, 2]}
    weights = {"actor.0.weight": np.zeros((2, FEATURES), np.float32), "actor.0.bias": np.zeros(2, np.float32)}
    save_file(weights, folder / WEIGHTS)
    edit_card(folder, architecture=wide, weights_sha256=None)
    assert "chooses 2 actions" in refusal(folder)
    assert LearnedPolicy.load(folder).act(np.zeros((1, FEATURES)), None, None).shape == (1, 2)


def test_without_a_scenario_any_agent_is_read(folder):
    assert LearnedPolicy.load(folder).name == folder.name


def test_nothing_is_ever_unpickled(folder, monkeypatch):
    """Neither by loading nor by flying, whichever way pickles are usually opened."""

    def forbidden(*arguments, **named):
        raise AssertionError("something was unpickled")

    for module, name in ((pickle, "load"), (pickle, "loads"), (pickle, "Unpickler"), (torch, "load"), (np, "load")):
        monkeypatch.setattr(module, name, forbidden)
    with pytest.raises(AssertionError, match="unpickled"):
        torch.load(io.BytesIO())
    policy = LearnedPolicy.load(folder, SCENARIO)
    assert policy.act(np.zeros((1, FEATURES)), None, None).shape == (1, 1)
