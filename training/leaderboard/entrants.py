"""Who plays: rules, planners, shipped agents and the trajectory optimum, as far as each can fly a variant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from agents import (
    RULE_NAMES,
    LearnedPolicy,
    Policy,
    TruthKnowing,
    agents_for,
    default_policies,
    find_policy,
    shipped,
)
from agents.agent_file import AgentFileError
from passloc_env.errors import ScenarioError
from passloc_env.units import MINUTE
from training.leaderboard.variants import Variant
from training.optimum import NAME, Settings
from training.optimum.future import check
from training.score import END_RMS, score_of
from training.stamp import stamp

Kind = Literal["rule", "planner", "learned", "truth", "optimum"]

OPTIMUM = "optimum"
"""How ``--policies`` calls the trajectory optimum."""

SETTINGS = Settings(objective="log_range_bound", restarts=8, iterations=100, polish=30, seed=0)
"""Of its search: modest, for it is a minute or so per variant and thousand episodes."""

_REFERENCE = "circle"
_THOROUGH = (
    "BearingsOnly",
    "BearingsOnlyFar",
    "OwnShipModerate",
    "OwnShipSevere",
    "BearingDoppler",
    "BearingDoppler-IMM",
    "CrossFix",
)
"""Variants that planners told the truth fly too, and the optimum where it can: these take most of the time."""

_SLOW = 4
"""Controls from which on only the greedy planner is fast enough."""

_QUICK_DECISIONS = 5.0
"""Seconds between decisions up to which horizons of less than a minute and a half make sense."""


@dataclass(frozen=True)
class Entrant:
    """One row of a table.

    Attributes:
        name: as tables call it.
        kind: of policy.
        policy: who decides; None for the optimum, which first has to be searched.
        stamp: what it is, in every detail that its results depend on.
    """

    name: str
    kind: Kind
    policy: Policy | None
    stamp: str


def entrants(variant: Variant, names: str = "") -> tuple[list[Entrant], list[str]]:
    """Who flies a variant, the reference first, and notes on who cannot.

    Args:
        variant: what is flown.
        names: policies separated by commas; by default rules, planners, shipped agents and the optimum.

    Raises:
        InputError: among the named policies one that does not exist or that cannot fly the variant.
    """
    if names:
        return _unique([_entrant(name.strip(), variant) for name in names.split(",")]), []
    scenario = variant.scenario
    texts = sorted(default_policies(scenario), key=lambda name: name != _REFERENCE)
    found = [_entrant(text, variant) for text in [*texts, *planners(variant)]]
    notes = []
    references = [OPTIMUM] if variant.name in _THOROUGH else []
    for text in [*(f"agent:{name}" for name in agents_for(scenario.name)), *references]:
        try:
            found.append(_entrant(text, variant))
        except (AgentFileError, ScenarioError) as error:
            name = text.removeprefix("agent:")
            notes.append(f"Without {name}: {str(error).replace(str(shipped.FOLDER / name), 'it')}.")
    return _unique(found), notes


def settings(variant: Variant) -> Settings:
    """How the trajectory optimum of a variant is searched: for the bound that its score is about."""
    return replace(SETTINGS, objective=score_of(variant.scenario).objective)


def planners(variant: Variant) -> tuple[str, ...]:
    """The planners that fly a variant by default, as :func:`agents.find_policy` takes them."""
    scenario = variant.scenario
    if not scenario.action_size:
        return ()
    if scenario.action_size >= _SLOW:
        return ("greedy",)
    interval = scenario.episode.interval
    if interval <= _QUICK_DECISIONS:
        spans: tuple[str, ...] = ("horizon:seconds=24", "horizon:seconds=48", "horizon:seconds=96")
    elif interval == MINUTE:
        spans = ("horizon:seconds=480", "horizon:seconds=960")
    else:
        spans = ("horizon",)
    middle = len(spans) // 2
    last = ("shrinking:objective=A:over=end",) if score_of(scenario) is END_RMS else ()
    if variant.family and interval <= _QUICK_DECISIONS:
        # Many decisions, each of them of its own geometry: only the planner that is mostly the best.
        return ("shrinking",)
    if variant.name not in _THOROUGH:
        return ("greedy", *spans[middle:], "shrinking", *last)
    twins = ("greedy-truth", spans[middle].replace("horizon", "horizon-truth"), "shrinking-truth")
    return ("greedy", *spans, "shrinking", *last, *twins)


def _entrant(text: str, variant: Variant) -> Entrant:
    if text == OPTIMUM:
        check(variant.scenario)
        return Entrant(NAME, "optimum", None, repr(settings(variant)))
    policy = find_policy(text, variant.scenario)
    return Entrant(policy.name, _kind(text, policy), policy, stamp(policy))


def _kind(text: str, policy: Policy) -> Kind:
    if isinstance(policy, TruthKnowing):
        return "truth"
    if isinstance(policy, LearnedPolicy):
        return "learned"
    return "rule" if text.split(":")[0] in RULE_NAMES else "planner"


def _unique(found: list[Entrant]) -> list[Entrant]:
    """The entrants, each once."""
    return list({entrant.name: entrant for entrant in found}.values())
