"""What RL Baselines3 Zoo reads is what we train with, and its trainer runs on it."""

import inspect
import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

from passloc_env import SCENARIOS
from passloc_env.scenarios import environment_id
from training.hyperparameters import Hyperparameters

ROOT = Path(__file__).parents[2]
ZOO = {"policy", "policy_kwargs", "n_timesteps", "n_envs", "normalize", "env_kwargs"}


def test_every_scenario_has_its_entry() -> None:
    from training.rl_zoo3 import hyperparams

    assert list(hyperparams) == [environment_id(name) for name in SCENARIOS]


@pytest.mark.parametrize("name", SCENARIOS)
def test_an_entry_says_what_our_own_training_does(name: str) -> None:
    ppo = pytest.importorskip("stable_baselines3").PPO
    from training.rl_zoo3 import hyperparams

    entry, own = hyperparams[environment_id(name)], Hyperparameters.for_scenario(name)
    assert entry.keys() - ZOO <= inspect.signature(ppo).parameters.keys()
    taken = (entry["n_timesteps"], entry["n_envs"], entry["n_steps"], entry["n_epochs"], entry["batch_size"])
    assert taken == (own.decisions, own.environments, own.rollout, own.epochs, own.batch_size)
    assert (entry["gamma"], entry["gae_lambda"], entry["ent_coef"]) == (own.discount, own.trace_decay, own.entropy)
    assert entry["policy_kwargs"] == {"net_arch": list(own.network), "log_std_init": own.initial_log_sigma}
    assert float(entry["learning_rate"].removeprefix("lin_")) == own.learning_rate
    # Stable-Baselines3 warns of a last batch that is cut short.
    assert entry["n_envs"] * entry["n_steps"] % entry["batch_size"] == 0
    env = gymnasium.make(environment_id(name), **entry.get("env_kwargs", {}))
    assert env.unwrapped.scenario == SCENARIOS[name].override(own.overrides)


def test_the_zoo_trains(tmp_path: Path) -> None:
    pytest.importorskip("rl_zoo3")
    command = "-m rl_zoo3.train --algo ppo --gym-packages passloc_env --conf-file training.rl_zoo3 --eval-freq -1"
    smaller = ["n_envs:4", "n_steps:8", "batch_size:32", "n_epochs:1"]
    subprocess.run(
        [sys.executable, *command.split(), "--env", "passloc/BearingsOnly-v0", "-n", "32", "-params", *smaller],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
    )
    assert (tmp_path / "logs/ppo/passloc-BearingsOnly-v0_1/passloc-BearingsOnly-v0.zip").is_file()
