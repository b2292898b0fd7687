"""Our hyperparameters as RL Baselines3 Zoo reads them: ``python -m rl_zoo3.train … --conf-file training.rl_zoo3``.

What the zoo's plain PPO has a word for is taken over, and computed from the YAML files of
:mod:`training.hyperparameters` whenever it is asked for. It has none for choices instead of a Gaussian action, mirror
symmetry, the privileged critic, the shield, the price of a violation and several families at once; and where our
training multiplies the reward by a number, the zoo divides it by the running deviation of the return.
"""

from __future__ import annotations

from typing import Any

from passloc_env.scenarios import SCENARIOS, environment_id
from training.hyperparameters import Hyperparameters


def zoo_hyperparameters(parameters: Hyperparameters) -> dict[str, Any]:
    """One entry of the zoo's file for PPO."""
    entry: dict[str, Any] = {
        "policy": "MlpPolicy",
        "policy_kwargs": {"net_arch": list(parameters.network), "log_std_init": parameters.initial_log_sigma},
        "n_timesteps": parameters.decisions,
        "n_envs": parameters.environments,
        "learning_rate": f"lin_{parameters.learning_rate}",
        "normalize": {"norm_obs": False, "norm_reward": True},
        **parameters.ppo_keywords,
    }
    if parameters.overrides:
        entry["env_kwargs"] = {"overrides": parameters.overrides}
    return entry


hyperparams = {environment_id(name): zoo_hyperparameters(Hyperparameters.for_scenario(name)) for name in SCENARIOS}
"""By Gymnasium id; the name is the zoo's."""
