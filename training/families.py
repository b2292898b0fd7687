"""Several problems learnt as one: an agent that is to fly them all meets all of them in training."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from passloc_env.errors import InputError, ScenarioError
from passloc_env.models import observation_names
from passloc_env.scenario import Scenario
from training.hyperparameters import Hyperparameters
from training.privileged import truth_names
from training.wrappers import Stepped


def families_of(scenario: Scenario, parameters: Hyperparameters) -> tuple[Scenario, ...]:
    """What is trained on: the scenario with the overrides of the hyperparameters, and then those of each family.

    Raises:
        ScenarioError: an unknown field or an impossible value.
        InputError: families that one agent cannot fly, or more of them than environments.
    """
    trained = scenario.override(parameters.overrides)
    families = tuple(_changed(trained, index, changes) for index, changes in enumerate(parameters.families)) or (
        trained,
    )
    if len(families) > parameters.environments:
        raise InputError(
            f"environments = {parameters.environments} is not possible: {len(families)} families need one each at least"
        )
    for index, family in enumerate(families):
        if _trade(family) != _trade(trained):
            raise InputError(f"families.{index} is not possible: it shows or asks something else than {trained.name}")
    return families


def _changed(trained: Scenario, index: int, changes: dict[str, Any]) -> Scenario:
    try:
        return trained.override(changes)
    except ScenarioError as error:
        raise error.inside(f"families.{index}") from None


def _trade(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """What an agent sees, what its critic may be told, and what its actions mean."""
    controls = tuple(f"{type(platform).__name__} {getattr(platform, 'control', '')}" for platform in scenario.platforms)
    return observation_names(scenario), truth_names(scenario), controls


def shares(environments: int, families: int) -> list[int]:
    """How many environments each family gets: as even as can be, the first ones one more."""
    return [environments // families + (index < environments % families) for index in range(families)]


class Together(VecEnv):
    """Environments of several kinds side by side, for one learner.

    Args:
        worlds: of the same spaces, in the order in which their environments are counted.
    """

    def __init__(self, worlds: Sequence[VecEnv]) -> None:
        # SB3's constructor calls get_attr, so the fields come first.
        self.worlds = tuple(worlds)
        ends = np.cumsum([world.num_envs for world in worlds])
        self._parts = [slice(end - world.num_envs, end) for world, end in zip(worlds, ends, strict=True)]
        seen, acting = worlds[0].observation_space, worlds[0].action_space
        if any((world.observation_space, world.action_space) != (seen, acting) for world in worlds):
            raise ValueError("worlds side by side must have the same spaces")
        super().__init__(int(ends[-1]), seen, acting)

    @property
    def seen(self) -> int:
        """Number of features that an actor sees, where the critic sees more."""
        return int(self.worlds[0].seen)  # type: ignore[attr-defined]

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds for the next reset, independent between worlds."""
        words = np.random.SeedSequence(seed).generate_state(len(self.worlds), np.uint64)
        return [own for world, word in zip(self.worlds, words, strict=True) for own in world.seed(int(word))]

    def reset(self) -> np.ndarray:
        """Begin new episodes everywhere; observations ``(n_envs, f)``."""
        return np.concatenate([world.reset() for world in self.worlds])

    def step_async(self, actions: np.ndarray) -> None:
        """Each world its own actions."""
        for world, part in zip(self.worlds, self._parts, strict=True):
            world.step_async(actions[part])

    def step_wait(self) -> Stepped:
        """The step of all worlds."""
        observation, reward, done, infos = zip(*(world.step_wait() for world in self.worlds), strict=True)
        everyone = [info for own in infos for info in own]
        return np.concatenate(observation), np.concatenate(reward), np.concatenate(done), everyone

    def close(self) -> None:
        """Release all worlds."""
        for world in self.worlds:
            world.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """The attribute of each environment's world."""
        values = [value for world in self.worlds for value in world.get_attr(attr_name)]
        return [values[index] for index in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Set an attribute of all worlds; ValueError for some environments only, which share it."""
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name} is shared by the environments of a world: set it for all of them")
        for world in self.worlds:
            world.set_attr(attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of each world once; its result stands for each of its environments."""
        results = [
            result for world in self.worlds for result in world.env_method(method_name, *method_args, **method_kwargs)
        ]
        return [results[index] for index in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None) -> list[bool]:
        """Whether each environment's world is."""
        wrapped = [value for world in self.worlds for value in world.env_is_wrapped(wrapper_class)]
        return [wrapped[index] for index in self._get_indices(indices)]
