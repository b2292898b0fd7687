"""PPO without a look at each environment learns what Stable-Baselines3's own PPO learns."""

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from passloc_env.sb3 import make_vec_env
from training.vector_ppo import LeanRolloutBuffer, VectorPPO, _stacked

SHORT = {"episode.steps": 24}
"""Six decisions: several episodes end, by time and otherwise, within a rollout."""


class Kept(BaseCallback):
    """Keeps every rollout's arrays."""

    def __init__(self) -> None:
        super().__init__()
        self.rollouts: list[dict[str, np.ndarray]] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        buffer = self.locals["rollout_buffer"]
        names = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs", "advantages")
        self.rollouts.append({name: getattr(buffer, name).copy() for name in names})


def learned(kind: type[PPO], bootstrap: bool) -> tuple[Kept, PPO]:
    torch.manual_seed(0)
    env = make_vec_env("BearingsOnly", 9, overrides=SHORT, seed=1, bootstrap_time_limit=bootstrap)
    agent = kind("MlpPolicy", env, n_steps=10, batch_size=30, n_epochs=2, seed=2, device="cpu")
    kept = Kept()
    agent.learn(180, callback=kept)
    return kept, agent


@pytest.mark.parametrize("bootstrap", [False, True])
def test_rollouts_are_those_of_sb3(bootstrap: bool) -> None:
    """To single precision: the critic sees last observations together, and matrices round by their size."""
    (ours, agent), (theirs, reference) = learned(VectorPPO, bootstrap), learned(PPO, bootstrap)
    assert len(ours.rollouts) == 2
    assert isinstance(agent.rollout_buffer, LeanRolloutBuffer)
    for mine, other in zip(ours.rollouts, theirs.rollouts, strict=True):
        assert other["episode_starts"][1:].any()
        for name, values in mine.items():
            np.testing.assert_allclose(values, other[name], rtol=1e-4, atol=1e-5, err_msg=name)
    assert [dict(info) for info in agent.ep_info_buffer or ()] != []
    returns = [[info["r"] for info in model.ep_info_buffer or ()] for model in (agent, reference)]
    np.testing.assert_allclose(returns[0], returns[1], rtol=1e-4)


def test_time_limits_are_bootstrapped() -> None:
    """The rewards of the two differ exactly where time ran out, by the discounted value of the last observation."""
    with_value, without = (learned(VectorPPO, bootstrap)[0].rollouts[0] for bootstrap in (True, False))
    ends = np.roll(with_value["episode_starts"], -1, axis=0)[:-1] > 0.0
    differ = with_value["rewards"][:-1] != without["rewards"][:-1]
    assert differ.any()
    assert not (differ & ~ends).any()


def test_a_callback_can_end_a_rollout() -> None:
    class Stop(BaseCallback):
        def _on_step(self) -> bool:
            return self.n_calls < 3

    env = make_vec_env("BearingsOnly", 2, seed=0)
    agent = VectorPPO("MlpPolicy", env, n_steps=5, batch_size=10, device="cpu")
    agent.learn(100, callback=Stop())
    assert agent.num_timesteps == 6


def test_observations_with_names_are_stacked_by_name() -> None:
    stacked = _stacked([{"seen": np.zeros(3), "truth": np.ones(2)}, {"seen": np.ones(3), "truth": np.zeros(2)}])
    assert {name: values.shape for name, values in stacked.items()} == {"seen": (2, 3), "truth": (2, 2)}
