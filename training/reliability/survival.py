"""How many tracks are lost when sensors fail, with and without a gate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from agents import find_policy
from passloc_env.scenario import Scenario
from training.episodes import fly
from training.leaderboard.variants import Variant, variants
from training.statistics import Bootstrap, Estimate, rate

TRACKED: tuple[Variant, ...] = tuple(each for each in variants() if each.name in ("BearingsOnly", "BearingDoppler-IMM"))
"""One filter of an emitter that runs straight on, and several of one that manoeuvres."""

POLICIES = ("circle", "learned")
GATES = (0.0, 0.99, 0.999)
_MISSED = {"detection_probability": 0.7}
_OUTLIERS = _MISSED | {"faults.outlier_probability": 0.05}
_WIDE, _WIDER = ({"faults.outlier_scale": scale} for scale in (10.0, 30.0))
FAULTS: dict[str, dict[str, Any]] = {
    "none": {},
    "30 % missed": _MISSED,
    "30 % missed, 5 % outliers ten times as wide": _OUTLIERS | _WIDE,
    "30 % missed, 20 % late, 5 % outliers ten times as wide": _OUTLIERS | _WIDE | {"faults.late_probability": 0.2},
    "30 % missed, 5 % outliers thirty times as wide": _OUTLIERS | _WIDER,
}
"""What goes wrong with every sensor, in words and as overrides of its fields."""


class Case(NamedTuple):
    """What is flown, by whom, and what happens to it."""

    tracked: Variant
    faults: str
    policy: str
    gate: float

    @property
    def scenario(self) -> Scenario:
        """The variant's, with faults and gate."""
        sound = self.tracked.scenario
        sensors = range(len(sound.sensors))
        faults = {f"sensors.{index}.{name}": value for index in sensors for name, value in FAULTS[self.faults].items()}
        return sound.override(faults | {"tracker.gate": self.gate})


class Survival(NamedTuple):
    """What became of the tracks of a case; shares and intervals as :func:`training.statistics.rate` has it."""

    tracked: str
    """The title of the variant."""
    faults: str
    policy: str
    gate: float
    lost: Estimate
    end_error: Estimate
    """Median relative range error at the end."""


def cases() -> Iterator[Case]:
    """Every variant, fault, policy and gate."""
    return (Case(*each) for each in product(TRACKED, FAULTS, POLICIES, GATES))


def survivals(episodes: int, seed: int, progress: Callable[[int], None] = lambda done: None) -> list[Survival]:
    """All cases on the same episodes, with seeds ``seed, seed + 1, …``.

    Args:
        episodes: how many each.
        seed: of the first one.
        progress: called with the number of episodes just finished.
    """
    bootstrap, rows = Bootstrap(episodes), []
    for case in cases():
        scenario = case.scenario
        scores, _ = fly(scenario, find_policy(case.policy, scenario), episodes, seed, progress)
        error = bootstrap.estimate(scores.end_error, np.median)
        rows.append(Survival(case.tracked.title, *case[1:], rate(scores.lost), error))
    return rows
