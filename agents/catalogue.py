"""Policies by name, for the command line and for tables."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from agents import planning, rules, shipped
from agents.learned import LearnedPolicy, is_agent
from agents.parameters import Parameter, declared
from agents.policy import Policy
from passloc_env.errors import InputError, unknown_name
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Scenario


def _always(rule: type[rules.Rule]) -> Callable[[Scenario], Policy]:
    """Builds a rule that is the same in every scenario."""

    def build(scenario: Scenario) -> Policy:
        return rule()

    build.__doc__ = rule.__doc__
    return build


_RULES: dict[str, Callable[..., Policy]] = {
    "stationary": rules.stationary,
    "straight": _always(rules.Straight),
    "random": _always(rules.Random),
    "circle": _always(rules.Circle),
    "zigzag": rules.zigzag,
    "perpendicular": _always(rules.Perpendicular),
    "fly-at": _always(rules.FlyAt),
    "yaw": rules.yaw,
    "roll": rules.roll,
    "legs": rules.published_legs,
}

_PLANNERS: dict[str, Callable[..., Policy]] = {
    "greedy": planning.greedy,
    "horizon": planning.horizon,
    "shrinking": planning.shrinking,
    "greedy-truth": planning.knowing(planning.greedy),
    "horizon-truth": planning.knowing(planning.horizon),
    "shrinking-truth": planning.knowing(planning.shrinking),
}

_POLICIES = {**_RULES, **_PLANNERS}

LEARNED, AGENT = "learned", "agent:"
"""The shipped agent made for the scenario, and what stands before the name of any."""

RULE_NAMES = tuple(_RULES)
"""All rules; :func:`rules_for` says which of them a scenario can follow."""

_HEADINGS = ("straight", "circle", "zigzag", "perpendicular", "fly-at")
_BODY_RATES = ("yaw", "roll")

PLANNER_NAMES = tuple(_PLANNERS)
"""All planners; those that are told the truth say so."""


class PolicyError(InputError):
    """A policy that cannot be had; the message is one line."""


def find_policy(text: str, scenario: Scenario) -> Policy:
    """A policy from its name or from the path of a trained agent.

    Args:
        text: a rule or planner, with parameters after colons (``zigzag:angle=45:leg=80``, ``horizon:objective=D``),
            a shipped agent (``learned``: the one made for the scenario; ``agent:BearingsOnly``: the one of that name),
            or a run folder or agent file.
        scenario: the problem it is to be flown on.

    Raises:
        PolicyError: no such rule, planner or agent (with the closest name), a rule that nothing in the scenario can
            follow, an impossible parameter, or an agent that does not fit the scenario.
    """
    if text == LEARNED:
        return shipped.learned(scenario)
    if text.startswith(AGENT):
        return shipped.load(text.removeprefix(AGENT), scenario)
    name, *settings = text.split(":")
    if name not in _POLICIES:
        if text and is_agent(Path(text)):
            return LearnedPolicy.load(Path(text), scenario)
        known = "rule, planner, run folder or agent file"
        raise PolicyError(str(unknown_name("policy", text, _POLICIES, known, name=name)))
    objection = _objection(name, scenario)
    if objection:
        known = ", ".join(rules_for(scenario))
        raise PolicyError(f"policy = {text!r} is not possible: {objection}; known: {known}")
    taken = parameters_of(name)
    try:
        return _POLICIES[name](scenario, **dict(_setting(name, item, taken) for item in settings))
    except ValueError as error:
        raise PolicyError(f"policy = {text!r} is not possible: {error}") from None


def meaning_of(name: str) -> str:
    """What a rule or planner does, in a line."""
    return (inspect.getdoc(_POLICIES[name]) or "").partition("\n")[0]


def parameters_of(name: str) -> dict[str, Parameter]:
    """What a rule or planner can be told, by name, in order."""
    return declared(_POLICIES[name])


def default_policies(scenario: Scenario) -> tuple[str, ...]:
    """The rules that every table of a scenario carries: those that something in it can follow."""
    variants = {"zigzag": ("zigzag:angle=60", "zigzag:angle=30", *rules.TUNED_ZIGZAGS.get(scenario.name, ()))}
    return tuple(text for name in rules_for(scenario) for text in variants.get(name, (name,)))


def rules_for(scenario: Scenario) -> tuple[str, ...]:
    """The rules that something in a scenario can follow."""
    return tuple(name for name in RULE_NAMES if not _objection(name, scenario))


def _objection(name: str, scenario: Scenario) -> str:
    """Why nothing in a scenario can follow a rule; empty when something can."""
    if name == "random" and not scenario.action_size:
        return f"nothing in {scenario.name} can be commanded"
    if name in _HEADINGS and not any(isinstance(platform, TurnLimitedPlatform) for platform in scenario.platforms):
        return f"no platform of {scenario.name} chooses a heading"
    if name in _BODY_RATES and not any(platform.steers_body for platform in scenario.platforms):
        return f"no platform of {scenario.name} turns its body"
    if name == "legs" and scenario.name not in rules.PUBLISHED_LEGS:
        return f"no legs were published for {scenario.name}, only for {', '.join(rules.PUBLISHED_LEGS)}"
    return ""


def _setting(name: str, item: str, taken: Mapping[str, Parameter]) -> tuple[str, Any]:
    """A parameter by its name, as ``name=value`` gives it; ValueError unless the policy takes it."""
    key, _, value = item.partition("=")
    if key not in taken:
        raise ValueError(f"{name} takes no such parameter; known: {', '.join(taken) or 'none'}")
    return key, taken[key].kind.read(key, value)
