"""From a scenario to its plan, by way of a trial flight."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from passloc_env.compiled.flight import Flight
from passloc_env.compiled.graph import TraceError
from passloc_env.compiled.plan import Plan
from passloc_env.compiled.stage import live_arrays

_TAXI = 3
"""Decisions flown before the example is taken: by then everything is as it usually is."""


@lru_cache(maxsize=64)
def plan_of(scenario: Any, simulate: Callable[..., Any]) -> Plan | None:
    """The plan of a scenario; ``simulate`` makes a simulation.

    None when its code is no straight-line arithmetic, or when the system allows no code to be made.
    """
    simulation = simulate(scenario.override({"episode.early_end": False}), 1, straight=False)
    _begin(simulation, seed=0)
    for _ in range(min(_TAXI, scenario.episode.steps // scenario.episode.decision_every)):
        simulation.step(np.full((scenario.action_size, 1), 0.5))
    try:
        with np.errstate(all="ignore"):
            plan = Plan(simulation)
            return plan if _does_the_same(plan, simulation) else None
    except (TraceError, OSError):
        return None


def _does_the_same(plan: Plan, simulation: Any) -> bool:
    """Whether a decision and an opening flown by the plan are those that the simulation makes by its own methods.

    They are not where a component keeps a memory, or draws numbers, of its own.
    """
    flown = copy.deepcopy(simulation)
    flown.straight, flown.flight = True, Flight(plan, flown)
    for fly in (_decide, _begin):
        fly(simulation)
        fly(flown)
        theirs = live_arrays(flown)
        same = [np.array_equal(array, theirs[name], equal_nan=True) for name, array in live_arrays(simulation).items()]
        if not all(same) or not np.array_equal(flown.observe(), simulation.observe()):
            return False
    return True


def _decide(simulation: Any) -> None:
    simulation.step(np.full(simulation.action.shape, -0.25))


def _begin(simulation: Any, seed: int = 1) -> None:
    simulation.reset(np.arange(1), [np.random.default_rng(seed)])
