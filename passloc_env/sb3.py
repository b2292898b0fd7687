"""Adapter to Stable-Baselines3: the native vector environment as a ``VecEnv``. Importing it imports SB3 and torch.

SB3 resets finished environments within the step that finishes them and expects three things that adapters often get
wrong: the last observation, copied, in ``info["terminal_observation"]``; ``info["TimeLimit.truncated"]`` only where the
episode was cut short by time and not terminated; and a seed of its own for each environment.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from passloc_env.belief import Belief
from passloc_env.infos import Infos
from passloc_env.scenario import Scenario
from passloc_env.vector_env import LocalisationVectorEnv


def make_vec_env(
    scenario: str | Mapping[str, Any] | Scenario = "BearingsOnly",
    n_envs: int = 256,
    *,
    overrides: Mapping[str, Any] | None = None,
    seed: int | None = None,
    bootstrap_time_limit: bool = True,
    diagnostics: bool = False,
    workers: int = 1,
) -> LocalisationVecEnv:
    """Many environments for Stable-Baselines3.

    Args:
        scenario: name, Gymnasium id, plain data or a Scenario.
        n_envs: how many environments.
        overrides: scenario fields to change, by dotted name.
        seed: seeds every environment on its own, from one ``SeedSequence``; None: fresh entropy.
        bootstrap_time_limit: whether the value of the last state counts when time runs out. The observation holds the
            time left, so an agent that is to use its time well is trained with False.
        diagnostics: put what only the world knows into the info of finished episodes.
        workers: on how many processes to fly, at most; see :class:`~passloc_env.LocalisationVectorEnv`.

    Raises:
        ScenarioError: an unknown scenario or field, or an impossible value.
    """
    env = LocalisationVectorEnv(
        n_envs,
        scenario,
        overrides=overrides,
        autoreset_mode=AutoresetMode.SAME_STEP,
        diagnostics=diagnostics,
        workers=workers,
    )
    adapter = LocalisationVecEnv(env, bootstrap_time_limit=bootstrap_time_limit)
    if seed is not None:
        adapter.seed(seed)
    return adapter


class LocalisationVecEnv(VecEnv):
    """A :class:`~passloc_env.LocalisationVectorEnv` in mode ``SameStep`` as an SB3 ``VecEnv``.

    Infos are empty but for finished environments, which carry ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return, decisions, seconds since the start) and the final info of the episode.
    """

    def __init__(self, env: LocalisationVectorEnv, bootstrap_time_limit: bool = True) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"the environment must reset within the step ('SameStep'), not {env.autoreset_mode.value!r}"
            )
        # SB3's constructor calls get_attr, so the fields come first.
        self.env, self.bootstrap_time_limit = env, bootstrap_time_limit
        self._actions: np.ndarray = np.zeros(env.action_space.shape or (), np.float32)
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._begun = time.time()
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds for the next reset, independent between environments and between runs.

        All of them are at least 2⁶², so that no training episode ever shares its seed with an evaluation, which counts
        up from a small number.
        """
        state = np.random.SeedSequence(seed).generate_state(self.num_envs, np.uint64)
        self._seeds = [int(word) >> 2 | 1 << 62 for word in state]
        return self._seeds

    def reset(self) -> np.ndarray:
        """Begin new episodes everywhere; observations ``(n_envs, f)``."""
        observation, _ = self.env.reset(seed=self._seeds)
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return observation

    def get_state(self) -> dict[str, Any]:
        """A snapshot, from which :meth:`set_state` continues bit for bit."""
        return {"env": self.env.get_state(), "returns": self._returns.copy(), "lengths": self._lengths.copy()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go back to a snapshot; ValueError when it is of another shape."""
        self.env.set_state(state["env"])
        self._returns, self._lengths = state["returns"].copy(), state["lengths"].copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions ``(n_envs, a)`` for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards float32, dones and infos of the step."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        self._returns += reward
        self._lengths += 1
        done = terminated | truncated
        out_of_time = truncated & ~terminated
        finished = np.flatnonzero(done).tolist()
        infos = Infos(self.num_envs, {at: self._final_info(at, info, bool(out_of_time[at])) for at in finished})
        self._returns[done], self._lengths[done] = 0.0, 0
        return observation, reward.astype(np.float32), done, infos

    def _final_info(self, index: int, info: dict[str, Any], out_of_time: bool) -> dict[str, Any]:
        episode = {
            "r": float(self._returns[index]),
            "l": int(self._lengths[index]),
            "t": round(time.time() - self._begun, 6),
        }
        return {
            **_row(info["final_info"], index),
            "terminal_observation": info["final_obs"][index].copy(),
            "TimeLimit.truncated": out_of_time and self.bootstrap_time_limit,
            "episode": episode,
        }

    @property
    def belief(self) -> Belief:
        """What policies may know, batched."""
        return self.env.belief

    def close(self) -> None:
        """Release the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """The attribute of the vector environment, once per index."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Set an attribute of the vector environment; ValueError for some environments only, which share it."""
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name} is shared by all environments: set it for all of them")
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once; its result stands for each index."""
        result = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None) -> list[bool]:
        """Nothing is wrapped."""
        return [False for _ in self._get_indices(indices)]


def _row(info: dict[str, Any], index: int) -> dict[str, Any]:
    """The info of one environment out of Gymnasium's vector form."""
    return {
        key: _row(value, index) if isinstance(value, dict) else value[index]
        for key, value in info.items()
        if not key.startswith("_")
    }
