"""A tiny training run: what it writes, that it repeats itself, and that its agent flies."""

import csv
import dataclasses
import json
import math

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.callbacks import BaseCallback, CallbackList

from agents import AgentFile, LearnedPolicy, find_policy
from passloc_env import SCENARIOS, LocalisationVectorEnv, Scenario, ScenarioError
from passloc_env.sb3 import make_vec_env
from training.commands import Train
from training.curve import COLUMNS, CurveCallback
from training.hyperparameters import HyperparameterError, Hyperparameters
from training.learner import build_ppo
from training.train import Run, run, train
from training.wrappers import ScaledReward

TINY = Hyperparameters(
    decisions=512, environments=8, rollout=16, batch_size=64, epochs=2, learning_rate=1e-2, network=(8, 8)
)
SCENARIO = SCENARIOS["BearingsOnly"].override({"episode.steps": 40, "name": "Short"})
"""Episodes of ten decisions, so that several end within 512."""

YAML = """\
decisions: 512
environments: 8
rollout: 16
batch_size: 64
epochs: 1
network: [8]
"""


def weights_of(finished: Run) -> bytes:
    return b"".join(finished.agent.weights[name].tobytes() for name in sorted(finished.agent.weights))


pytestmark = pytest.mark.usefixtures("logs_of_its_own")


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    return run(SCENARIO, TINY, tmp_path_factory.mktemp("run"), seed=3)


@pytest.fixture
def arguments(tmp_path, monkeypatch):
    """Arguments of a tiny run, made in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(YAML, encoding="utf-8")
    return Train(hyperparameters=tmp_path / "tiny.yaml", override=("episode.steps=40",))


def test_run_folder_is_complete(finished):
    names = {path.name for path in finished.folder.iterdir()}
    assert names == {".lock", "config.json", "curve.csv", "tensorboard", "agent.json", "agent.safetensors"}
    assert any(path.name.startswith("events") for path in (finished.folder / "tensorboard").iterdir())
    assert finished.seconds > 0.0


def test_configuration_says_everything(finished):
    config = json.loads((finished.folder / "config.json").read_text(encoding="utf-8"))
    assert config.keys() == {"scenario", "hyperparameters", "seed", "provenance"}
    assert Scenario.from_dict(config["scenario"]) == SCENARIO
    written = config["hyperparameters"]
    lists = {name: tuple(written[name]) for name in ("network", "families")}
    assert Hyperparameters(**written | lists) == TINY
    assert config["seed"] == 3
    assert config["provenance"]["versions"]["numpy"] == np.__version__


def test_learning_curve(finished):
    """One row per rollout in which episodes ended; returns as the environment gave them, not as the learner sees."""
    with (finished.folder / "curve.csv").open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == COLUMNS
    assert [float(row[0]) for row in rows] == [128.0, 256.0, 384.0, 512.0]
    assert [[float(value) for value in row] for row in rows] == [list(row.values()) for row in finished.curve]
    for row in finished.curve:
        assert 1.0 <= row["mean_length"] <= 10.0
        assert 0.0 <= row["violations"] <= 1.0
        # Ten decisions with a reward of −ln(σ_r / r) each, around one; the learner's returns are fifty times smaller.
        assert 2.0 < row["mean_return"] < 100.0
    seconds = [row["seconds"] for row in finished.curve]
    assert seconds == sorted(seconds)


def test_every_row_of_the_curve_is_about_its_own_rollout(tmp_path):
    """Against the infos that a second callback kept."""
    episodes = []

    class Keep(BaseCallback):
        def _on_rollout_start(self):
            episodes.append([])

        def _on_step(self):
            episodes[-1].extend(info for info in self.locals["infos"] if info)
            return True

    curve = CurveCallback(tmp_path / "curve.csv")
    model = build_ppo(make_vec_env(SCENARIO, 8, seed=0), TINY, seed=0)
    model.learn(512, callback=CallbackList([curve, Keep()]))
    assert len(curve.rows) == len(episodes) == 4
    for row, infos in zip(curve.rows, episodes, strict=True):
        # Six digits are kept.
        assert row["mean_return"] == pytest.approx(np.mean([info["episode"]["r"] for info in infos]), abs=1e-6)
        assert row["mean_length"] == pytest.approx(np.mean([info["episode"]["l"] for info in infos]), abs=1e-6)
        assert row["violations"] == pytest.approx(np.mean([info["violated"] for info in infos]), abs=1e-6)


def test_the_agent_is_what_was_trained_and_flies(finished):
    again = AgentFile.load(finished.folder)
    assert all(np.array_equal(again.weights[name], array) for name, array in finished.agent.weights.items())
    training = again.card["training"]
    assert (training["decisions"], training["seed"], training["algorithm"]) == (512, 3, "PPO")
    assert again.scenario == SCENARIO
    assert again.card["architecture"] == {"actor": [17, 8, 8, 1]}
    policy = find_policy(str(finished.folder), SCENARIO)
    assert isinstance(policy, LearnedPolicy)
    env = make_vec_env(SCENARIO, 4, seed=0)
    observation, ended = env.reset(), 0
    for _ in range(10):
        actions = policy.act(observation, env.belief, np.random.default_rng(0))
        assert np.abs(actions).max() <= 1.0
        observation, _, dones, _ = env.step(actions)
        ended += dones.sum()
    assert ended >= 4


def test_same_seed_same_weights(finished, tmp_path):
    for name in ("again", "other"):
        (tmp_path / name).mkdir()
    again = run(SCENARIO, TINY, tmp_path / "again", seed=3)
    other = run(SCENARIO, TINY, tmp_path / "other", seed=4)
    assert weights_of(again) == weights_of(finished)
    assert weights_of(other) != weights_of(finished)
    strip = [[{k: v for k, v in row.items() if k != "seconds"} for row in r.curve] for r in (again, finished, other)]
    assert strip[0] == strip[1] != strip[2]


def test_training_moves_the_actor(finished):
    """Against the same networks before the first gradient step."""
    model = build_ppo(make_vec_env(SCENARIO, 8, seed=3), TINY, seed=3)
    before = model.policy.action_net.weight.detach().numpy()
    assert before.shape == finished.agent.weights["actor.2.weight"].shape
    assert np.abs(before - finished.agent.weights["actor.2.weight"]).max() > 1e-3


@pytest.mark.parametrize("decisions", [512, 500, 129, 1])
def test_the_learning_rate_falls_to_zero_and_never_below(decisions):
    """A whole rollout is flown even where a part of it would do: the rest must not be *un*learnt at a negative rate."""
    parameters = dataclasses.replace(TINY, decisions=decisions)
    model = build_ppo(make_vec_env(SCENARIO, 8, seed=0), parameters, seed=0)
    rates = []

    class Watch(BaseCallback):
        def _on_rollout_start(self):
            rates.append(model.lr_schedule(model._current_progress_remaining))

        def _on_step(self):
            return True

    model.learn(decisions, callback=Watch())
    rates.append(model.policy.optimizer.param_groups[0]["lr"])
    assert rates[0] == 1e-2
    assert rates == sorted(rates, reverse=True)
    assert rates[-1] >= 0.0


def test_hyperparameters_reach_ppo():
    parameters = dataclasses.replace(TINY, discount=0.9, trace_decay=0.8, entropy=0.01, initial_log_sigma=-0.5)
    model = build_ppo(make_vec_env(SCENARIO, 8, seed=0), parameters, seed=0)
    assert (model.gamma, model.gae_lambda, model.ent_coef) == (0.9, 0.8, 0.01)
    assert (model.n_steps, model.batch_size, model.n_epochs) == (16, 64, 2)
    assert model.policy.log_std.item() == -0.5
    assert [m.out_features for m in model.policy.mlp_extractor.policy_net if isinstance(m, torch.nn.Linear)] == [8, 8]
    assert any(isinstance(m, torch.nn.Tanh) for m in model.policy.mlp_extractor.policy_net)
    assert model.lr_schedule(0.25) == pytest.approx(2.5e-3)


def test_scaled_reward_scales_the_reward_and_nothing_else():
    plain, scaled = (make_vec_env(SCENARIO, 4, seed=0) for _ in range(2))
    wrapper = ScaledReward(scaled, 0.02)
    assert np.array_equal(wrapper.reset(), plain.reset())
    for _ in range(10):
        observation, reward, dones, infos = plain.step(np.zeros((4, 1)))
        found = wrapper.step(np.zeros((4, 1)))
        assert np.array_equal(found[0], observation)
        assert (found[1].dtype, found[1].tolist()) == (np.float32, (reward * np.float32(0.02)).tolist())
        assert np.array_equal(found[2], dones)
        assert [i.get("episode", {}).get("r") for i in found[3]] == [i.get("episode", {}).get("r") for i in infos]
    assert dones.any()


def test_time_limits_are_not_bootstrapped(monkeypatch, tmp_path):
    """Time left is in the observation, so the last state of an episode is worth nothing more."""
    asked = []
    monkeypatch.setattr("training.learner.make_vec_env", lambda *a, **k: asked.append(k) or make_vec_env(*a, **k))
    run(SCENARIO, dataclasses.replace(TINY, decisions=1), tmp_path, seed=0)
    assert [k["bootstrap_time_limit"] for k in asked] == [False]


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_trains_as_its_file_says(name, tmp_path, monkeypatch):
    """One rollout with the shipped hyperparameters; the agent then flies the scenario itself, not the family."""
    monkeypatch.chdir(tmp_path)
    finished = train(Train(name, decisions=1))
    assert finished.folder.as_posix() == f"runs/{name}-0"
    assert all(np.isfinite(weights).all() for weights in finished.agent.weights.values())
    policy = find_policy(str(finished.folder), SCENARIOS[name])
    env = LocalisationVectorEnv(3, SCENARIOS[name])
    observation, _ = env.reset(seed=0)
    actions = policy.act(observation, env.belief, np.random.default_rng(0))
    assert env.action_space.contains(np.asarray(actions, np.float32))


def test_training_may_change_the_scenario_for_itself(arguments, tmp_path):
    """The file's overrides come on top of the command's, and card and configuration tell what was trained on."""
    (tmp_path / "tiny.yaml").write_text(YAML + "overrides: {sensors.0.sigma: 0.01}\n", encoding="utf-8")
    finished = train(dataclasses.replace(arguments, decisions=1))
    config = json.loads((finished.folder / "config.json").read_text(encoding="utf-8"))
    for scenario in (finished.agent.scenario, Scenario.from_dict(config["scenario"])):
        assert scenario.sensors[0].sigma == 0.01
        assert scenario.episode.steps == 40


def test_runs_are_numbered_and_never_written_into(arguments):
    folders = [train(dataclasses.replace(arguments, decisions=1)).folder for _ in range(3)]
    assert [folder.as_posix() for folder in folders] == [f"runs/BearingsOnly-0{end}" for end in ("", ".1", ".2")]
    assert all((folder / "agent.json").is_file() for folder in folders)
    other = train(dataclasses.replace(arguments, decisions=1, seed=5)).folder
    assert other.as_posix() == "runs/BearingsOnly-5"


def test_a_folder_in_use_is_refused_and_left_alone(arguments, tmp_path):
    target = tmp_path / "mine"
    target.mkdir()
    (target / "notes.txt").write_text("precious", encoding="utf-8")
    with pytest.raises(FileExistsError, match="--out") as caught:
        train(dataclasses.replace(arguments, out=target))
    assert "\n" not in str(caught.value)
    assert [path.name for path in target.iterdir()] == ["notes.txt"]
    with pytest.raises(OSError, match="notes"):
        train(dataclasses.replace(arguments, out=target / "notes.txt"))
    assert (target / "notes.txt").read_text(encoding="utf-8") == "precious"


def test_an_empty_or_new_folder_is_used(arguments, tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("empty", "new/deep"):
        finished = train(dataclasses.replace(arguments, out=tmp_path / name, decisions=1))
        assert finished.folder == tmp_path / name
        assert (finished.folder / "agent.safetensors").is_file()
    assert not (tmp_path / "runs").exists()


def test_arguments_say_what_is_trained(arguments):
    finished = train(dataclasses.replace(arguments, decisions=200, seed=9, scenario="passloc/BearingsOnlyFar-v0"))
    config = json.loads((finished.folder / "config.json").read_text(encoding="utf-8"))
    assert config["scenario"]["name"] == "BearingsOnlyFar"
    assert config["scenario"]["episode"]["steps"] == 40
    assert config["hyperparameters"]["decisions"] == 200
    assert config["hyperparameters"]["network"] == [8]
    # 200 decisions are two rollouts of 128.
    assert finished.agent.card["training"]["decisions"] == 128 * math.ceil(200 / 128)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"scenario": "BearingOnly"}, ScenarioError),
        ({"override": ("episode.stepz=4",)}, ScenarioError),
        ({"override": ("episode.steps",)}, ScenarioError),
        ({"decisions": 0}, HyperparameterError),
        ({"decisions": -3}, HyperparameterError),
        ({"seed": -1}, ValueError),
    ],
    ids=str,
)
def test_refusals_leave_no_folder_behind(arguments, tmp_path, change, error):
    with pytest.raises(error) as caught:
        train(dataclasses.replace(arguments, **change))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "runs").exists()


def test_overrides_of_a_file_are_checked_before_a_folder_is_made(arguments, tmp_path):
    (tmp_path / "tiny.yaml").write_text(YAML + "overrides: {episode.stepz: 4}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="steps"):
        train(arguments)
    assert not (tmp_path / "runs").exists()
