"""What stands between an environment and its learner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.learned import choices_of
from agents.shield import Shield
from agents.symmetry import MirrorSymmetry
from passloc_env.belief import Belief

Stepped = tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]
TERMINAL = "terminal_observation"


class ScaledReward(VecEnvWrapper):
    """Multiplies the reward for the learner; episode returns in the infos stay as they are."""

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self._scale = scale

    def reset(self) -> Any:
        """Begin new episodes."""
        return self.venv.reset()

    def step_wait(self) -> Stepped:
        """The step with its reward scaled."""
        observation, reward, done, infos = self.venv.step_wait()
        return observation, reward * np.float32(self._scale), done, infos


class RisingPrice(VecEnvWrapper):
    """Makes episodes that end in a violation dearer and dearer, linearly from nothing.

    Dear from the start, violations teach a beginner to stay far away, which it never unlearns: what is to be found near
    the emitter must be found first.

    Args:
        venv: the environment; its violations end episodes.
        price: what a violation costs at the end of training.
        decisions: of the whole training, in all environments.
    """

    def __init__(self, venv: VecEnv, price: float, decisions: int) -> None:
        super().__init__(venv)
        self._price, self._decisions = price, decisions
        self._flown = 0

    def reset(self) -> Any:
        """Begin new episodes; the price stays."""
        return self.venv.reset()

    def get_state(self) -> dict[str, Any]:
        """How far the price has risen."""
        return {"flown": self._flown}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Put it back."""
        self._flown = int(state["flown"])

    def step_wait(self) -> Stepped:
        """The step, violations paid for; episode returns in the infos stay as they are."""
        observation, reward, done, infos = self.venv.step_wait()
        price = np.float32(self._price * min(self._flown / self._decisions, 1.0))
        self._flown += self.num_envs
        violated = [bool(ended and info["violated"]) for ended, info in zip(done, infos, strict=True)]
        return observation, np.where(violated, reward - price, reward), done, infos


class Guarded(VecEnvWrapper):
    """Flies behind a shield: what it replaces is part of the world that the learner meets."""

    def __init__(self, venv: VecEnv, shield: Shield) -> None:
        super().__init__(venv)
        self._shield = shield

    def reset(self) -> Any:
        """Begin new episodes."""
        return self.venv.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """The actions that leave a way out."""
        belief: Belief = self.getattr_recursive("belief")
        self.venv.step_async(self._shield.guard(belief, actions).astype(np.float32))

    def step_wait(self) -> Stepped:
        """The step."""
        return self.venv.step_wait()


class Mirrored(VecEnvWrapper):
    """Shows the learner one side of the world only (see :class:`~agents.symmetry.MirrorSymmetry`)."""

    def __init__(self, venv: VecEnv, symmetry: MirrorSymmetry) -> None:
        super().__init__(venv)
        self._symmetry = symmetry
        self._sides = np.ones((venv.num_envs, 1), np.float32)

    def reset(self) -> Any:
        """Begin new episodes."""
        return self._mirrored(cast(np.ndarray, self.venv.reset()))

    def get_state(self) -> dict[str, Any]:
        """The side that each environment was shown from."""
        return {"sides": self._sides.copy()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Put it back."""
        self._sides = state["sides"].copy()

    def step_async(self, actions: np.ndarray) -> None:
        """The actions, mirrored back."""
        self.venv.step_async(actions * self._sides)

    def step_wait(self) -> Stepped:
        """The step, every observation mirrored as its own side says."""
        observation, reward, done, infos = self.venv.step_wait()
        for index in np.flatnonzero(done):
            last = infos[index][TERMINAL][None]
            infos[index][TERMINAL] = self._symmetry.mirrored(last, self._symmetry.sides(last))[0]
        return self._mirrored(cast(np.ndarray, observation)), reward, done, infos

    def _mirrored(self, observation: np.ndarray) -> np.ndarray:
        self._sides = self._symmetry.sides(observation)
        return self._symmetry.mirrored(observation, self._sides)


class Choosing(VecEnvWrapper):
    """Offers the learner a few values of each action component, evenly spread, to choose from.

    A Gaussian heading cannot weigh port against starboard without trying what lies between them; a choice can.
    """

    def __init__(self, venv: VecEnv, choices: int) -> None:
        size = cast(spaces.Box, venv.action_space).shape[0]
        super().__init__(venv, action_space=spaces.MultiDiscrete([choices] * size))
        self._values = choices_of(choices)

    def reset(self) -> Any:
        """Begin new episodes."""
        return self.venv.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """The values chosen."""
        self.venv.step_async(self._values[actions])

    def step_wait(self) -> Stepped:
        """The step."""
        return self.venv.step_wait()
