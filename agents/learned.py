"""Trained policies, flown with NumPy alone."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agents.agent_file import CARD, WEIGHTS, AgentFile, AgentFileError
from agents.shield import Shield
from agents.symmetry import MirrorSymmetry
from passloc_env.belief import Belief
from passloc_env.errors import InputError
from passloc_env.models import observation_names
from passloc_env.scenario import Scenario


def choices_of(count: int) -> np.ndarray:
    """The values ``(count,)`` that an agent chooses a component of its action from: evenly spread around the circle.

    As many to port as to starboard; neither straight towards the emitter nor straight away is among an even number.
    """
    return ((2.0 * np.arange(count) + 1.0) / count - 1.0).astype(np.float32)


class LearnedPolicy:
    """The deterministic actor of a trained agent: a multilayer perceptron with tanh between its layers.

    What comes out is the action or, if its card speaks of choices, how good each of them is. As its card says, it sees
    the world in a mirror where the emitter lies to the other side, and flies behind a shield.
    """

    overrides: Mapping[str, Any] = {}

    def __init__(self, agent: AgentFile, name: str = "learned") -> None:
        self.name, self.agent = name, agent
        self._layers = [(weight.T.copy(), bias) for weight, bias in agent.layers]
        sigmas = float(agent.card.get("shield_sigmas", 0.0))
        self._shield = Shield(sigmas) if sigmas else None
        choices = int(agent.card.get("choices", 0))
        self._choices = choices_of(choices) if choices else None
        self._symmetry = MirrorSymmetry(agent.scenario) if agent.card.get("mirror") else None
        self._env: Any = None

    @classmethod
    def load(cls, path: Path, scenario: Scenario | None = None) -> LearnedPolicy:
        """Read an agent and see that it fits a scenario.

        Args:
            path: run folder or agent file.
            scenario: the problem to fly; None: any.

        Raises:
            AgentFileError: unreadable files, or an agent that sees or does something else than the scenario offers.
        """
        agent = AgentFile.load(path)
        if scenario is not None:
            _check_fit(agent, scenario, path)
        folder = path if path.is_dir() else path.parent
        return cls(agent, name=folder.resolve().name)

    def act(self, observation: np.ndarray, belief: Belief | None, rng: np.random.Generator | None) -> np.ndarray:
        """The actions ``(N, a)`` for observations ``(N, f)``; the belief is the shield's, random numbers nobody's."""
        seen = np.asarray(observation, dtype=np.float32)
        if self._symmetry is None:
            actions = self._actor(seen)
        else:
            sides = self._symmetry.sides(seen)
            actions = self._actor(self._symmetry.mirrored(seen, sides)) * sides
        if self._shield is None or belief is None:
            return actions
        return self._shield.guard(belief, actions)

    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, None]:
        """:meth:`act`, as Stable-Baselines3 asks its models; the shield sees through :meth:`with_belief_of` alone.

        Args:
            observation: of one environment ``(f,)`` or of a batch ``(N, f)``.
            state: none is kept.
            episode_start: nor does it matter when an episode began.
            deterministic: True or False, the action is the same: a file holds the actor without its spread.

        Returns:
            The action ``(a,)`` or the actions ``(N, a)``, each within [-1, 1], and no state.

        Raises:
            InputError: an observation of another shape, or of more or fewer environments than the belief.
        """
        seen = self._checked(observation)
        batch = np.atleast_2d(seen)
        belief = None if self._env is None else self._env.belief
        if belief is not None and len(belief.time) != len(batch):
            raise InputError(f"observation has N = {len(batch)}: the environment's belief has N = {len(belief.time)}")
        if belief is None and self._shield is not None:
            words = (
                f"{self.name} flies without its shield, which needs a belief: agent.with_belief_of(env) gives it one"
            )
            warnings.warn(words, stacklevel=2)
        actions = self.act(batch, belief, None)
        return actions if seen.ndim == 2 else actions[0], None

    def with_belief_of(self, env: Any) -> LearnedPolicy:
        """The same agent for :meth:`predict`: its shield looks at what an environment's tracker believes.

        Args:
            env: any environment of passloc, wrapped or not. The observations must be those that it returned last.

        Raises:
            InputError: an environment that has no belief.
        """
        inner = getattr(env, "unwrapped", env)
        if not hasattr(type(inner), "belief"):
            raise InputError(f"env = {type(inner).__name__} is not possible: must be an environment of passloc")
        policy = copy.copy(self)
        policy._env = inner
        return policy

    def _checked(self, observation: Any) -> np.ndarray:
        """The observation as an array ``(f,)`` or ``(N, f)``; InputError for all else."""
        features = len(self._layers[0][0])
        try:
            seen = np.asarray(observation, dtype=np.float32)
            found = f"of shape {seen.shape}"
        except (TypeError, ValueError):
            seen, found = np.empty(0, np.float32), f"a {type(observation).__name__}"
        if seen.ndim not in (1, 2) or seen.shape[-1] != features:
            wanted = f"of shape ({features},) or (N, {features}), as {self.agent.scenario.name} returns it"
            raise InputError(f"observation is {found}: must be {wanted}")
        return seen

    def _actor(self, hidden: np.ndarray) -> np.ndarray:
        for weight, bias in self._layers[:-1]:
            hidden = np.tanh(hidden @ weight + bias)
        weight, bias = self._layers[-1]
        out = hidden @ weight + bias
        if self._choices is None:
            return np.clip(out, -1.0, 1.0)
        return self._choices[np.argmax(out.reshape(len(out), -1, len(self._choices)), axis=2)]


def is_agent(path: Path) -> bool:
    """Whether a path is meant as an agent: a folder, or one of an agent's two files."""
    return path.is_dir() or path.name in (WEIGHTS, CARD)


def _check_fit(agent: AgentFile, scenario: Scenario, path: Path) -> None:
    sees = list(agent.card.get("observation", []))
    offered = list(observation_names(scenario))
    if sees != offered:
        raise AgentFileError(
            f"{path} was trained on {agent.scenario.name} and sees {len(sees)} features; "
            f"{scenario.name} offers {len(offered)}, which are not the same"
        )
    acts = agent.actions
    if acts != scenario.action_size:
        raise AgentFileError(f"{path} chooses {acts} actions; {scenario.name} takes {scenario.action_size}")
