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

from passloc_env.reading import json_data
from training.archives import read_arrays
from training.episodes import Scores, fly
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
        policy = entrant.policy
        if policy is None:
            seeds = range(self.seed, self.seed + self.episodes)
            path = self._path(variant, entrant, "paths")
            path.parent.mkdir(parents=True, exist_ok=True)
            policy = optimise(
                variant.scenario, seeds, **vars(settings(variant)), cache=path, progress=progress
            ).policy()
            scores, seconds = fly(variant.scenario, policy, self.episodes, self.seed)
        else:
            scores, seconds = fly(variant.scenario, policy, self.episodes, self.seed, progress)
        self._keep(variant, entrant, scores, seconds)
        return scores, seconds

    def forget(self, variant: Variant, entrant: Entrant) -> None:
        """Remove what is here of a policy."""
        for what in ("scores", "paths"):
            self._path(variant, entrant, what).unlink(missing_ok=True)

    def _keep(self, variant: Variant, entrant: Entrant, scores: Scores, seconds: float) -> None:
        path = self._path(variant, entrant, "scores")
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(path.name + ".partial")
        about = np.array(json.dumps(self._stamp(variant, entrant)))
        with partial.open("wb") as file:
            np.savez_compressed(file, about=about, seconds=np.array(seconds), **vars(scores))
        partial.replace(path)

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
