"""What policies are ranked by: what the reward of a scenario says that it is about."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from passloc_env.rewards import FinalBound, PositionError
from passloc_env.scenario import Scenario
from training.statistics import Estimate, root_mean_square

if TYPE_CHECKING:
    from training.episodes import Scores
    from training.evaluate import Verdict


@dataclass(frozen=True)
class Score:
    """A figure that ranks policies; lower is better.

    Attributes:
        column: its heading in tables.
        of: the figure of a verdict, in SI units.
        cost: the same of episodes as a logarithm, so that 0.1 is 10 % everywhere.
        axis: what pictures write along its axis; which is logarithmic where the figure is not yet.
        objective: what the trajectory optimum minimises for it, see :func:`training.optimum.optimise`.
        scale, digits: how tables write it.
        remark: a sentence for tables that are not sorted by their first column; empty for the others.
    """

    column: str
    of: Callable[[Verdict], Estimate]
    cost: Callable[[Scores], float]
    axis: str
    objective: str = "log_range_bound"
    scale: float = 1.0
    digits: int = 3
    remark: str = ""

    def cell(self, verdict: Verdict) -> Estimate:
        """The figure as tables write it."""
        return self.of(verdict).scaled(self.scale)


LOG_RANGE_BOUND = Score(
    "log range bound",
    lambda verdict: verdict.log_range_bound,
    lambda scores: float(scores.log_range_bound.mean()),
    r"log range bound: mean over time of $\ln(\sigma_r / r)$; further left is better",
)
"""How well the path lets one know the range, all the time: the headline."""

END_ERROR = Score(
    "end error, m",
    lambda verdict: verdict.end_position_error,
    lambda scores: math.log(np.median(scores.end_position_error)),
    "median position error at the end, m; further left is better",
    digits=1,
    remark="Sorted by the end error in metres, which the reward counts.",
)
"""Where the range means little."""

END_RMS = Score(
    "end error RMS, km",
    lambda verdict: verdict.end_rms,
    lambda scores: math.log(root_mean_square(scores.end_position_error)),
    "position error at the end, RMS, km; further left is better",
    objective="end_position_bound",
    scale=1e-3,
    remark="Sorted by the RMS position error at the end, whose bound the reward counts.",
)
"""Where the literature judges the last estimate, tails and all."""


def score_of(scenario: Scenario) -> Score:
    """What a scenario's policies are ranked by."""
    if any(isinstance(term, PositionError) for term in scenario.reward):
        return END_ERROR
    if any(isinstance(term, FinalBound) for term in scenario.reward):
        return END_RMS
    return LOG_RANGE_BOUND
