"""The table that sets a blind fixed station beside observers that move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents import find_policy
from passloc_env.arrays import Array
from passloc_env.scenario import Scenario
from training.papers.monte_carlo import History, run
from training.papers.reproduction import Reproduction
from training.statistics import Bootstrap, Estimate, root_mean_square

HEADINGS = (
    "observer",
    "RMS error at the end, %",
    "[95 %]",
    "bound, %",
    "RMS / bound",
    "ANEES [band]",
    "lost, %",
    "closest, km",
)

STUCK, CONVERGED = 0.8, 0.05
"""An error that keeps four fifths of what it was does not converge; one below 5 % of the range has."""

CRITERIA = "converged: RMS below 5 % of the range at the end; not converging: above 80 % of what it began with"

EFFICIENT = (0.9, 1.25)
"""Ratios of RMS error to bound of a tracker that makes the most of its measurements."""

MOVING = ("straight", "circle", "zigzag:angle=60", "perpendicular")
"""Rules that every blind case is tried with."""


def fixed_against_moving(
    reproduction: Reproduction, title: str, scenario: Scenario, runs: int, rules: Sequence[str] = MOVING
) -> dict[str, History]:
    """Fly a case with the fixed station and with observers that move, and record the table; histories by rule."""
    histories = {
        rule: run(scenario, runs, reproduction.seed, rule, engine=reproduction.engine)
        for rule in ("stationary", *rules)
    }
    rows = [row(find_policy(rule, scenario).name, history) for rule, history in histories.items()]
    reproduction.table(title, HEADINGS, rows)
    return histories


def row(name: str, history: History) -> tuple[str, ...]:
    """One observer's figures at the end of the runs."""
    error, consistent = history.relative_rms_at(np.inf), history.end_anees
    return (
        name,
        f"{100.0 * error.value:.3g}",
        f"{100.0 * error.low:.3g}–{100.0 * error.high:.3g}",
        f"{100.0 * history.relative_bound[-1]:.3g}",
        f"{history.efficiency[-1]:.2f}",
        f"{consistent.value:.2f} [{consistent.low:.2f}, {consistent.high:.2f}]",
        f"{100.0 * history.lost:.0f}",
        f"{history.range.min() / 1e3:.1f}",
    )


def error_ratio(over: Array, under: Array) -> Estimate:
    """Ratio of the RMS of errors ``(N,)`` in the same runs, with its bootstrap interval."""

    def statistic(pairs: Array, axis: int) -> Array:
        return root_mean_square(pairs[..., 0], axis) / root_mean_square(pairs[..., 1], axis)

    return Bootstrap(len(over)).estimate(np.stack([over, under], axis=-1), statistic)
