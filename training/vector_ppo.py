"""Stable-Baselines3's PPO with rollouts that do nothing environment by environment.

Its own loop looks at every environment's info in every step, and asks for the value of every last observation on its
own: with a thousand environments that takes as long as the environments do. What is learned is the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.common.vec_env import VecEnv


class VectorPPO(PPO):
    """PPO for vector environments of any size, with actions from a ``Box`` or a ``MultiDiscrete``."""

    def _setup_model(self) -> None:
        if self.rollout_buffer_class is None and not isinstance(self.observation_space, spaces.Dict):
            self.rollout_buffer_class = LeanRolloutBuffer
        super()._setup_model()

    def collect_rollouts(self, env: VecEnv, callback: BaseCallback, rollout_buffer: Any, n_rollout_steps: int) -> bool:
        """Fill the buffer with the present policy; False when a callback has ended the training."""
        assert self._last_obs is not None
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        for _ in range(n_rollout_steps):
            with torch.no_grad():
                actions, values, log_probs = self.policy(obs_as_tensor(self._last_obs, self.device))  # type: ignore[arg-type]
            chosen = actions.cpu().numpy()
            new_obs, rewards, dones, infos = env.step(self._flown(chosen))
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            finished = [(index, infos[index]) for index in np.flatnonzero(dones)]
            self._update_info_buffer([info for _, info in finished], dones[dones])
            cut = [(index, info) for index, info in finished if info.get("TimeLimit.truncated", False)]
            if cut:
                last = _stacked([info["terminal_observation"] for _, info in cut])
                rewards[[index for index, _ in cut]] += self.gamma * self._values_of(last)
            rollout_buffer.add(self._last_obs, chosen, rewards, self._last_episode_starts, values, log_probs)
            self._last_obs, self._last_episode_starts = new_obs, dones  # type: ignore[assignment]
        with torch.no_grad():
            values = self.policy.predict_values(obs_as_tensor(new_obs, self.device))  # type: ignore[arg-type]
        rollout_buffer.compute_returns_and_advantage(last_values=values, dones=dones)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _flown(self, chosen: np.ndarray) -> np.ndarray:
        """What the environment is told: a Gaussian knows no bounds."""
        space = self.action_space
        return np.clip(chosen, space.low, space.high) if isinstance(space, spaces.Box) else chosen

    def _values_of(self, observations: Any) -> np.ndarray:
        """The critic's opinion of several observations, in one call."""
        with torch.no_grad():
            values: np.ndarray = self.policy.predict_values(obs_as_tensor(observations, self.device)).cpu().numpy()
        return values.flatten()


class LeanRolloutBuffer(RolloutBuffer):
    """A rollout whose arrays are filled without copies in between."""

    def add(
        self,
        obs: np.ndarray,
        action: np.ndarray,
        reward: np.ndarray,
        episode_start: np.ndarray,
        value: torch.Tensor,
        log_prob: torch.Tensor,
    ) -> None:
        """One decision of every environment."""
        here = self.pos
        self.observations[here], self.actions[here] = obs, action
        self.rewards[here], self.episode_starts[here] = reward, episode_start
        self.values[here], self.log_probs[here] = value.numpy().flatten(), log_prob.numpy()
        self.pos += 1
        self.full = self.pos == self.buffer_size


def _stacked(observations: list[Any]) -> Any:
    """Observations as one, array by array where they have names."""
    if isinstance(observations[0], dict):
        return {name: np.stack([each[name] for each in observations]) for name in observations[0]}
    return np.stack(observations)
