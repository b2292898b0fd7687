"""How many tracks are lost when sensors fail, with and without a gate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents import find_policy
from passloc_env import SCENARIOS
from training.episodes import fly
from training.statistics import Bootstrap, Estimate, rate

SCENARIO = "BearingsOnly"
POLICIES = ("circle", "learned")
GATES = (0.0, 0.99, 0.999)
_MISSED = {"sensors.0.detection_probability": 0.7}
_OUTLIERS = _MISSED | {"sensors.0.faults.outlier_probability": 0.05}
FAULTS: dict[str, dict[str, Any]] = {
    "none": {},
    "30 % missed": _MISSED,
    "30 % missed, 5 % outliers ten times as wide": _OUTLIERS | {"sensors.0.faults.outlier_scale": 10.0},
    "30 % missed, 5 % outliers thirty times as wide": _OUTLIERS | {"sensors.0.faults.outlier_scale": 30.0},
}
"""What goes wrong, in words and as overrides."""


class Survival(NamedTuple):
    """What became of the tracks under some faults; shares and intervals as :func:`training.statistics.rate` has it."""

    faults: str
    policy: str
    gate: float
    lost: Estimate
    end_error: Estimate
    """Median relative range error at the end."""


def survivals(episodes: int, seed: int, progress: Callable[[int], None] = lambda done: None) -> list[Survival]:
    """Every fault, policy and gate on the same episodes, with seeds ``seed, seed + 1, …``.

    Args:
        episodes: how many each.
        seed: of the first one.
        progress: called with the number of episodes just finished.
    """
    bootstrap, rows = Bootstrap(episodes), []
    for faults, changes in FAULTS.items():
        for policy in POLICIES:
            for gate in GATES:
                scenario = SCENARIOS[SCENARIO].override(changes | {"tracker.gate": gate})
                scores, _ = fly(scenario, find_policy(policy, scenario), episodes, seed, progress)
                error = bootstrap.estimate(scores.end_error, np.median)
                rows.append(Survival(faults, policy, gate, rate(scores.lost), error))
    return rows
