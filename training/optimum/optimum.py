"""The result of a search: paths, what they are worth, and a file to keep them in."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.errors import InputError
from passloc_env.reading import json_data
from passloc_env.scenario import Scenario
from training.archives import read_arrays
from training.files import appearing
from training.optimum.replay import Replay

_ARRAYS = ("seeds", "headings", "paths", "values", "legal", "chosen")


@dataclass(frozen=True)
class Settings:
    """How a search was made; see :func:`training.optimum.optimise`."""

    objective: str
    restarts: int
    iterations: int
    polish: int
    seed: int


@dataclass(frozen=True)
class Optimum:
    """The best path found for each episode, with the true future known: how much room is left for policies.

    A heuristic optimum: the bound has many local minima, and more restarts find better ones.

    Attributes:
        scenario: the problem.
        settings: how the search was made.
        seeds: of the episodes ``(N,)``.
        headings: heading set-point of each decision ``(N, decisions)``, rad, not wrapped.
        paths: observer position after each sensor step ``(2, steps, N)``, m.
        values: what each restart came to, log range bound or metres ``(N, restarts)``.
        legal: whether it stays outside min_range ``(N, restarts)``.
        chosen: the best legal restart, or the best where none is legal ``(N,)``.
    """

    scenario: Scenario
    settings: Settings
    seeds: IntArray
    headings: Array
    paths: Array
    values: Array
    legal: BoolArray
    chosen: IntArray

    @property
    def value(self) -> Array:
        """The objective of the chosen paths ``(N,)``."""
        best: Array = np.take_along_axis(self.values, self.chosen[:, None], axis=1)[:, 0]
        return best

    @property
    def violated(self) -> BoolArray:
        """Where no legal path was found ``(N,)``."""
        return np.logical_not(np.logical_or.reduce(self.legal, axis=1))

    def policy(self) -> Replay:
        """A policy that flies the chosen paths in exactly these episodes."""
        return Replay(self.scenario, self.seeds.tolist(), self.headings)

    def save(self, path: Path) -> None:
        """Write everything to an ``.npz`` file without pickles; the file appears whole or not at all."""
        about = json.dumps({"scenario": self.scenario.to_dict(), "settings": vars(self.settings)})
        with appearing(path) as partial, partial.open("wb") as file:
            np.savez_compressed(file, about=np.array(about), **{name: getattr(self, name) for name in _ARRAYS})

    @classmethod
    def load(cls, path: Path) -> Optimum:
        """Read what :meth:`save` wrote; nothing is unpickled.

        Raises:
            InputError: a file that is not one of these.
            OSError: a file that cannot be read.
        """
        try:
            arrays = read_arrays(path, ("about", *_ARRAYS))
            about = json_data(str(arrays.pop("about")))
            optimum = cls(Scenario.from_dict(about["scenario"]), Settings(**about["settings"]), **arrays)
            optimum._check()
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path} is not a file of trajectory optima") from None
        return optimum

    def _check(self) -> None:
        """ValueError unless the arrays are of one search."""
        episodes, steps = len(self.seeds), self.scenario.episode.steps
        restarts, decisions = self.values.shape[-1:], steps // self.scenario.episode.decision_every
        expected = {
            "seeds": ("i", (episodes,)),
            "headings": ("f", (episodes, decisions)),
            "paths": ("f", (2, steps, episodes)),
            "values": ("f", (episodes, *restarts)),
            "legal": ("b", (episodes, *restarts)),
            "chosen": ("i", (episodes,)),
        }
        found = {name: (getattr(self, name).dtype.kind, getattr(self, name).shape) for name in _ARRAYS}
        if found != expected or not ((self.chosen >= 0) & (self.chosen < restarts[0])).all():
            raise ValueError("arrays that do not fit each other")
