"""RLlib trains on an environment that is registered with it."""

import gymnasium
import numpy as np
import pytest

import passloc_env

pytest.importorskip("ray.rllib")


@pytest.mark.filterwarnings("default")
def test_ppo_steps_one_iteration() -> None:
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.tune import register_env

    def make(config: dict) -> gymnasium.Env:
        return passloc_env.LocalisationEnv(**config)

    register_env("passloc", make)
    overrides = {"episode.steps": 16, "episode.early_end": False}
    config = (
        PPOConfig()
        .environment("passloc", env_config={"scenario": "BearingsOnly", "overrides": overrides})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=4)
        .training(train_batch_size_per_learner=64, minibatch_size=32, num_epochs=1)
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    try:
        result = algorithm.train()["env_runners"]
    finally:
        algorithm.stop()
        ray.shutdown()
    assert result["num_env_steps_sampled"] >= 64
    assert result["episode_len_mean"] == 4.0
    assert np.isfinite(result["episode_return_mean"])
