"""Planners by their parameters, for the catalogue, which sees that these are possible."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Annotated, Any

from agents.criterion import OBJECTIVES, SPANS, Criterion
from agents.parameters import Number, Word
from agents.planners import Greedy, Horizon, Planner, WithTruth
from passloc_env.platforms import Platform
from passloc_env.scenario import Scenario
from passloc_env.units import MINUTE

_DECISIONS = 12
"""Decisions that a horizon covers unless told otherwise."""

_LOOKS_TO_THE_END = 12
"""Looks of a horizon that begins as long as the episode."""


Objective = Annotated[
    str, Word("what the plan minimises: ln(σ_r / r), or the trace or determinant of P", tuple(OBJECTIVES))
]
Margin = Annotated[
    float, Number("the forecast range, less so much, must not be below the minimum range", "standard deviations")
]
Caution = Annotated[
    float,
    Number("how long the deviation in that margin is the one without further measurements", "decisions", endless=True),
]
Looks = Annotated[int, Number("looks at the forecast geometry, about", least=1, whole=True)]


def greedy(
    scenario: Scenario,
    objective: Objective = "D",
    margin: Margin = Criterion.margin,
    caution: Caution = Criterion.caution,
    grid: Annotated[int, Number("actions compared per component", least=2, whole=True)] = Greedy.grid,
) -> Greedy:
    """Look one decision ahead and take the best of a grid of actions.

    Raises:
        ValueError: a scenario that cannot be planned for.
    """
    _check(scenario)
    criterion = Criterion(objective=objective, span="end", margin=margin, caution=caution)
    return Greedy(name=f"greedy {objective}", criterion=criterion, grid=grid)


def horizon(
    scenario: Scenario,
    seconds: Annotated[
        float | None, Number("how far it looks ahead", "s", above=True, by_default=f"{_DECISIONS} decisions")
    ] = None,
    looks: Looks = Horizon.looks,
    **others: Annotated[Any, _searching],
) -> Horizon:
    """Plan some legs over a receding horizon, fly the beginning of the first, and plan anew.

    Raises:
        ValueError: a scenario that cannot be planned for.
    """
    length = _DECISIONS * scenario.episode.interval if seconds is None else seconds
    return _searching(scenario, "horizon", length, looks, **others)


def shrinking(scenario: Scenario, looks: Looks = _LOOKS_TO_THE_END, **others: Annotated[Any, _searching]) -> Horizon:
    """Plan some legs over all that is left of the episode, fly the beginning of the first, and plan anew.

    Raises:
        ValueError: a scenario that cannot be planned for.
    """
    return _searching(scenario, "shrinking", math.inf, looks, **others)


def _searching(
    scenario: Scenario,
    kind: str,
    seconds: float,
    looks: int,
    objective: Objective = Criterion.objective,
    over: Annotated[str, Word("when that counts: on average over the horizon, or at its end", SPANS)] = Criterion.span,
    margin: Margin = Criterion.margin,
    caution: Caution = Criterion.caution,
    legs: Annotated[int, Number("legs of a plan", least=1, whole=True)] = Horizon.legs,
    generations: Annotated[
        int | None, Number("generations of the search after the first", whole=True, by_default="one per control")
    ] = None,
) -> Horizon:
    """A planner that searches; by default for one generation per control, since there is more to search."""
    _check(scenario)
    words = [kind, objective, *([] if over == "mean" else [over]), *([] if math.isinf(seconds) else [_told(seconds)])]
    return Horizon(
        name=" ".join(words),
        criterion=Criterion(objective=objective, span=over, margin=margin, caution=caution),
        seconds=seconds,
        looks=looks,
        legs=legs,
        generations=scenario.action_size if generations is None else generations,
    )


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


def _told(seconds: float) -> str:
    return f"{seconds:g} s" if seconds < 5 * MINUTE else f"{seconds / MINUTE:g} min"
