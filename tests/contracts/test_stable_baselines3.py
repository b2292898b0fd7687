"""What Stable-Baselines3 asks of an environment, for every registered id."""

import gymnasium
import pytest

from passloc_env import SCENARIOS
from passloc_env.scenarios import environment_id

env_checker = pytest.importorskip("stable_baselines3.common.env_checker")


@pytest.mark.parametrize("name", SCENARIOS)
def test_check_env(name):
    env = gymnasium.make(environment_id(name), diagnostics=True).unwrapped
    env_checker.check_env(env, warn=True)
    # SB3 takes an environment with a method of this name for a goal environment.
    assert not hasattr(env, "compute_reward")
    assert not any(hasattr(env.unwrapped, name) for name in ("envs", "num_envs"))
