"""A critic that sees the truth: in training somebody must say how well things go, and need not guess.

What an episode is worth depends mostly on where the emitter happens to be. A critic that sees the belief alone must
average over all emitters that the belief allows, and what it cannot tell is noise in every gradient of the actor. Here
the critic is shown the truth beside the belief; the actor sees the belief alone, and only the actor is ever flown
(Pinto et al., *Asymmetric Actor Critic for Image-Based Robot Learning*, RSS 2018).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from passloc_env.batch import Batch
from passloc_env.belief import OBSERVATION_LIMIT
from passloc_env.models import state_layout
from passloc_env.sb3 import LocalisationVecEnv
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from training.wrappers import TERMINAL, Stepped


def truth_names(scenario: Scenario) -> tuple[str, ...]:
    """The name of each feature that only the critic sees: those of a belief in the state of the bound."""
    layout = state_layout(scenario, scenario.bound.motion)
    return scenario.observation.names(layout, scenario.platforms, scenario.own_ship)


class WithTruth(VecEnvWrapper):
    """Appends what nobody may fly by: the features of a belief that is the truth, as uncertain as its bound.

    The last observation of an episode cannot be told any more once the next one has begun: there the belief's own
    features are followed by zeros. Nothing is learnt from them unless time limits are bootstrapped.

    Attributes:
        seen: number of features that the actor sees, the first ones.
    """

    def __init__(self, venv: VecEnv) -> None:
        env = venv.unwrapped
        if not isinstance(env, LocalisationVecEnv):
            raise TypeError(f"{type(env).__name__} cannot tell the truth")
        if not isinstance(env.env.batch, Batch):
            raise TypeError("the worlds of a batch with workers cannot tell the truth: build it with workers=1")
        self._batch = env.env.batch
        self._hidden = len(truth_names(self._batch.scenario))
        self.seen = cast(spaces.Box, venv.observation_space).shape[0]
        space = spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (self.seen + self._hidden,), np.float32)
        super().__init__(venv, observation_space=space)

    def reset(self) -> Any:
        """Begin new episodes."""
        return self._told(cast(np.ndarray, self.venv.reset()))

    def step_wait(self) -> Stepped:
        """The step, the truth told."""
        observation, reward, done, infos = self.venv.step_wait()
        for index in np.flatnonzero(done):
            infos[index][TERMINAL] = np.pad(infos[index][TERMINAL], (0, self._hidden))
        return self._told(cast(np.ndarray, observation)), reward, done, infos

    def _told(self, observation: np.ndarray) -> np.ndarray:
        return np.concatenate([observation, self._batch.gather(_truth).astype(np.float32)], axis=1)


def _truth(tile: Simulation) -> np.ndarray:
    """The features ``(f, N)`` of a belief that is the truth."""
    scene = tile.bound_scene()
    with np.errstate(all="ignore"):
        belief = replace(tile.belief, mean=scene.state, covariance=tile.information.bound, layout=scene.layout)
        return tile.realised.observation.observe(belief)


class TwoViews(MlpExtractor):
    """Hidden layers of an actor that sees the first features and a critic that sees all of them."""

    def __init__(self, seen: int, features: int, architecture: list[int], activation: type[torch.nn.Module]) -> None:
        super().__init__(features, architecture, activation, device="cpu")
        self._seen = seen
        self.policy_net = MlpExtractor(seen, architecture, activation, device="cpu").policy_net

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """What the actor makes of what it sees."""
        return cast(torch.Tensor, self.policy_net(features[..., : self._seen]))


class PrivilegedPolicy(ActorCriticPolicy):
    """SB3's actor and critic, of which the actor sees the first ``seen`` features alone."""

    def __init__(self, *arguments: Any, seen: int, **parameters: Any) -> None:
        self._seen = seen
        super().__init__(*arguments, **parameters)

    def _build_mlp_extractor(self) -> None:
        architecture = list(cast(Iterable[int], self.net_arch))
        self.mlp_extractor = TwoViews(self._seen, self.features_dim, architecture, self.activation_fn)
