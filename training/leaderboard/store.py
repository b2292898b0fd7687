"""Results kept on disk, one file per variant and policy, so that a board goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents import Policy
from passloc_env.reading import json_data
from training.archives import read_arrays
from training.episodes import Flight, Scores, fly
from training.files import appearing
from training.leaderboard.entrants import Entrant, settings
from training.leaderboard.variants import Variant
from training.optimum import optimise

_FORMAT = "passloc-scores-1"


@dataclass(frozen=True)
class Store:
    """Per-episode scores of whoever flew, with a stamp that says what was flown.

    Results are used again as long as scenario, policy, episodes and seed are the same to the last digit. A change of
    the package's own code is not seen by the stamp.

    Attributes:
        folder: where the files lie.
        episodes: how many each policy flies.
        seed: of the first.
    """

    folder: Path
    episodes: int
    seed: int

    def kept(self, variant: Variant, entrant: Entrant) -> tuple[Scores, float] | None:
        """Scores and seconds per decision, if they are here; files that cannot be read count as absent."""
        names = ("about", "seconds", *Scores.__dataclass_fields__)
        try:
            arrays = read_arrays(self._path(variant, entrant, "scores"), names)
            if json_data(str(arrays.pop("about"))) != self._stamp(variant, entrant):
                return None
            seconds = float(arrays.pop("seconds"))
        except (OSError, ValueError, TypeError):
            return None
        whole = all(array.shape == (self.episodes,) and array.dtype.kind in "bf" for array in arrays.values())
        return (Scores(**arrays), seconds) if whole else None

    def flown(
        self, variant: Variant, entrant: Entrant, progress: Callable[[int], None] = lambda done: None
    ) -> tuple[Scores, float]:
        """Scores and seconds per decision, flown now and kept."""
        if entrant.policy is None:
            flight = self.flight(variant, self._optimum(variant, entrant, progress))
            scores, seconds = fly(*flight)
        else:
            scores, seconds = fly(*self.flight(variant, entrant.policy), progress)
        self.keep(variant, entrant, scores, seconds)
        return scores, seconds

    def flight(self, variant: Variant, policy: Policy) -> Flight:
        """What a policy has to fly."""
        return Flight(variant.scenario, policy, self.episodes, self.seed)

    def _optimum(self, variant: Variant, entrant: Entrant, progress: Callable[[int], None]) -> Policy:
        """The paths that a search finds, as a policy."""
        seeds = range(self.seed, self.seed + self.episodes)
        path = self._path(variant, entrant, "paths")
        path.parent.mkdir(parents=True, exist_ok=True)
        return optimise(variant.scenario, seeds, **vars(settings(variant)), cache=path, progress=progress).policy()

    def forget(self, variant: Variant, entrant: Entrant) -> None:
        """Remove what is here of a policy."""
        for what in ("scores", "paths"):
            self._path(variant, entrant, what).unlink(missing_ok=True)

    def keep(self, variant: Variant, entrant: Entrant, scores: Scores, seconds: float) -> None:
        """Write what a policy has flown; its file appears whole or not at all."""
        path = self._path(variant, entrant, "scores")
        path.parent.mkdir(parents=True, exist_ok=True)
        about = np.array(json.dumps(self._stamp(variant, entrant)))
        with appearing(path) as partial, partial.open("wb") as file:
            np.savez_compressed(file, about=about, seconds=np.array(seconds), **vars(scores))

    def _stamp(self, variant: Variant, entrant: Entrant) -> dict[str, Any]:
        stamp = {
            "format": _FORMAT,
            "scenario": variant.scenario.to_dict(),
            "policy": entrant.stamp,
            "name": entrant.name,
            "episodes": self.episodes,
            "seed": self.seed,
        }
        # As it comes back from the file: tuples are lists there.
        back: dict[str, Any] = json.loads(json.dumps(stamp))
        return back

    def _path(self, variant: Variant, entrant: Entrant, what: str) -> Path:
        name = re.sub(r"[^\w.-]+", "-", entrant.name.replace("°", "deg")).strip("-")
        # The stamp is part of the name, so that a short trial does not take the place of a long board.
        digest = hashlib.sha256(json.dumps(self._stamp(variant, entrant)).encode()).hexdigest()[:12]
        return self.folder / variant.name / f"{name}.{digest}.{what}.npz"
