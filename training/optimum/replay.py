"""Flying optimised paths in the environment itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from passloc_env.arrays import Array, IntArray
from passloc_env.belief import Belief
from passloc_env.errors import InputError
from passloc_env.platforms import PlanarPose, TurnLimitedPlatform
from passloc_env.scenario import Scenario
from passloc_env.vector_env import LocalisationVectorEnv

NAME = "trajectory optimum (truth)"
"""How tables call it: it knows the true future, as no policy can."""

_AT_ONCE = 1024


class Replay:
    """A policy that flies one given course in each of some episodes, and knows no others.

    An episode is recognised by its first belief, which no two share; the batch may hold the episodes in any order.

    Args:
        scenario: the problem.
        seeds: of the episodes.
        headings: heading set-points ``(episodes, decisions)``, rad.

    Raises:
        InputError: episodes that cannot be told apart.
    """

    name = NAME
    overrides: Mapping[str, Any] = {}

    def __init__(self, scenario: Scenario, seeds: Sequence[int], headings: Array) -> None:
        self._headings = headings
        self._known: dict[bytes, int] = {}
        for first in range(0, len(seeds), _AT_ONCE):
            part = [int(seed) for seed in seeds[first : first + _AT_ONCE]]
            env = LocalisationVectorEnv(len(part), scenario, autoreset_mode=AutoresetMode.DISABLED)
            env.reset(seed=part)
            self._known |= {key: first + index for index, key in enumerate(_keys(env.belief, range(len(part))))}
        if len(self._known) < len(seeds):
            raise InputError("seeds are not possible: some episodes begin alike, so that none can be recognised")
        self._episodes: IntArray = np.zeros(0, np.int64)

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """The actions ``(N, 1)`` that set the planned headings; InputError for an episode without a plan."""
        self._recognise(belief)
        platform, pose = belief.platforms[0], belief.poses[0]
        assert isinstance(platform, TurnLimitedPlatform)
        assert isinstance(pose, PlanarPose)
        decision = np.rint(belief.time / belief.interval).astype(np.int64)
        wanted = self._headings[self._episodes, np.minimum(decision, self._headings.shape[1] - 1)]
        return platform.action_towards(wanted, pose.heading, belief.bearing, belief.interval)[:, None]

    def _recognise(self, belief: Belief) -> None:
        """Note which episodes are about to begin."""
        if len(self._episodes) != len(belief.time):
            self._episodes = np.full(len(belief.time), -1)
        beginning = np.flatnonzero(belief.time == 0.0)
        for column, key in zip(beginning, _keys(belief, beginning), strict=True):
            self._episodes[column] = self._known.get(key, -1)
        unknown = np.flatnonzero(self._episodes < 0)
        if len(unknown):
            raise InputError(f"environments {unknown[:8].tolist()} fly an episode for which no path was optimised")


def _keys(belief: Belief, columns: Sequence[int] | IntArray) -> list[bytes]:
    """What tells episodes apart as they begin: the first belief and where the observer stands."""
    pose = belief.poses[0]
    rows = np.concatenate([belief.mean, pose.position, pose.velocity])
    return [rows[:, column].tobytes() for column in columns]
