"""Planners by their parameters, for the catalogue: what is impossible is said before anything flies."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

from agents.criterion import OBJECTIVES, SPANS, Criterion
from agents.planners import Greedy, Horizon, Planner, WithTruth
from passloc_env.platforms import Platform
from passloc_env.scenario import Scenario
from passloc_env.units import MINUTE

_DECISIONS = 12
"""Decisions that a horizon covers unless told otherwise."""

_LOOKS_TO_THE_END = 12
"""Looks of a horizon that begins as long as the episode."""


def greedy(
    scenario: Scenario,
    objective: str = "D",
    margin: float = Criterion.margin,
    caution: float = Criterion.caution,
    grid: float = Greedy.grid,
) -> Greedy:
    """One decision ahead, by default D-optimal.

    Raises:
        ValueError: a scenario that cannot be planned for, or an impossible parameter.
    """
    _check(scenario)
    return Greedy(
        name=f"greedy {objective}",
        criterion=_criterion(objective, "end", margin, caution),
        grid=_count("grid", grid, 2),
    )


def horizon(
    scenario: Scenario, seconds: float | None = None, looks: float = Horizon.looks, **parameters: Any
) -> Horizon:
    """A receding horizon, by default of twelve decisions.

    Args:
        scenario: the problem.
        seconds: how far it looks ahead.
        looks: looks at the forecast geometry.
        parameters: those of every search, see :func:`_searching`.

    Raises:
        ValueError: a scenario that cannot be planned for, or an impossible parameter.
    """
    length = _DECISIONS * scenario.episode.interval if seconds is None else seconds
    if not 0.0 < length < math.inf:
        raise ValueError("seconds must be a finite number above 0")
    return _searching(scenario, "horizon", length, looks, **parameters)


def shrinking(scenario: Scenario, looks: float = _LOOKS_TO_THE_END, **parameters: Any) -> Horizon:
    """A horizon that ends with the episode, the legs of a plan stretched over what is left; otherwise as before.

    Raises:
        ValueError: a scenario that cannot be planned for, or an impossible parameter.
    """
    return _searching(scenario, "shrinking", math.inf, looks, **parameters)


def _searching(
    scenario: Scenario,
    kind: str,
    seconds: float,
    looks: float,
    objective: str = "range",
    over: str = "mean",
    margin: float = Criterion.margin,
    caution: float = Criterion.caution,
    legs: float = Horizon.legs,
    generations: float | None = None,
) -> Horizon:
    """A planner that searches; by default for one generation per control, since there is more to search."""
    _check(scenario)
    words = [kind, objective, *([] if over == "mean" else [over]), *([] if math.isinf(seconds) else [_told(seconds)])]
    return Horizon(
        name=" ".join(words),
        criterion=_criterion(objective, over, margin, caution),
        seconds=seconds,
        looks=_count("looks", looks, 1),
        legs=_count("legs", legs, 1),
        generations=scenario.action_size if generations is None else _count("generations", generations, 0),
    )


SEARCHING = ("objective", "over", "margin", "caution", "legs", "generations")
"""What every search can be told."""


def knowing(planner: Callable[..., Planner]) -> Callable[..., WithTruth]:
    """The same planner with the true state."""

    @functools.wraps(planner)
    def build(scenario: Scenario, **parameters: Any) -> WithTruth:
        return WithTruth(planner(scenario, **parameters))

    return build


def _check(scenario: Scenario) -> None:
    if not scenario.action_size:
        raise ValueError(f"{scenario.name} has nothing that can be steered")
    for platform in scenario.platforms:
        if type(platform).state_at is Platform.state_at:
            raise ValueError(f"planners cannot tell the state of a {type(platform).__name__} from its pose")


def _criterion(objective: str, over: str, margin: float, caution: float) -> Criterion:
    if objective not in OBJECTIVES:
        raise ValueError(f"objective must be one of {', '.join(OBJECTIVES)}")
    if over not in SPANS:
        raise ValueError(f"over must be one of {', '.join(SPANS)}")
    if not 0.0 <= margin < math.inf:
        raise ValueError("margin must be a finite number of standard deviations of at least 0")
    if not caution >= 0.0:
        raise ValueError("caution must be a number of decisions of at least 0")
    return Criterion(objective=objective, span=over, margin=margin, caution=caution)


def _count(name: str, value: float, least: int) -> int:
    if not (math.isfinite(value) and value == int(value) and value >= least):
        raise ValueError(f"{name} must be a whole number of at least {least}")
    return int(value)


def _told(seconds: float) -> str:
    return f"{seconds:g} s" if seconds < 5 * MINUTE else f"{seconds / MINUTE:g} min"
