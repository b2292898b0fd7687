"""Policies by name, for the command line and for tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from agents import planning, rules
from agents.learned import LearnedPolicy, is_agent
from agents.policy import Policy
from passloc_env.errors import InputError, unknown_name
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Scenario

_RULES: dict[str, Callable[..., Policy]] = {
    "stationary": rules.stationary,
    "straight": lambda scenario: rules.Straight(),
    "random": lambda scenario: rules.Random(),
    "circle": lambda scenario: rules.Circle(),
    "zigzag": rules.zigzag,
    "perpendicular": lambda scenario: rules.Perpendicular(),
    "fly-at": lambda scenario: rules.FlyAt(),
    "yaw": lambda scenario: rules.BodyRate(),
    "roll": lambda scenario: rules.BodyRate(name="roll", rates=(1.0, 0.0, 0.0)),
    "legs": lambda scenario: rules.Legs(legs=_published_legs(scenario)),
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

_WORDS = ("objective", "over")
"""Parameters whose values are words; all others are numbers."""

RULE_NAMES = tuple(_RULES)
"""All rules; ``legs`` exists where legs were published."""

PLANNER_NAMES = tuple(_PLANNERS)
"""All planners; those that are told the truth say so."""


class PolicyError(InputError):
    """A policy that cannot be had; the message is one line."""


def find_policy(text: str, scenario: Scenario) -> Policy:
    """A policy from its name or from the path of a trained agent.

    Args:
        text: a rule or planner, with parameters after colons (``zigzag:angle=45:leg=80``, ``horizon:objective=D``), or
            a run folder or agent file.
        scenario: the problem it is to be flown on.

    Raises:
        PolicyError: no such rule, planner or agent (with the closest name), or one that does not fit the scenario.
    """
    name, *settings = text.split(":")
    if name not in _POLICIES:
        if text and is_agent(Path(text)):
            return LearnedPolicy.load(Path(text), scenario)
        raise PolicyError(
            str(unknown_name("policy", text, _POLICIES, "rule, planner, run folder or agent file", name=name))
        )
    try:
        return _POLICIES[name](scenario, **dict(_setting(item, text) for item in settings))
    except TypeError:
        raise PolicyError(f"policy = {text!r} is not possible: {name} takes no such parameter") from None
    except ValueError as error:
        raise PolicyError(f"policy = {text!r} is not possible: {error}") from None


def default_policies(scenario: Scenario) -> tuple[str, ...]:
    """The rules that every table of a scenario carries: those that something in it can follow."""
    zigzags = ("zigzag:angle=60", "zigzag:angle=30")
    names = ["stationary"]
    if any(isinstance(platform, TurnLimitedPlatform) for platform in scenario.platforms):
        names += ["straight", "random", "circle", *zigzags, "perpendicular", "fly-at"]
    elif scenario.action_size:
        names += ["random"]
    if any(platform.steers_body for platform in scenario.platforms):
        names += ["yaw", "roll"]
    if scenario.name in rules.PUBLISHED_LEGS:
        names += ["legs"]
    return tuple(names)


def _setting(item: str, text: str) -> tuple[str, Any]:
    key, _, value = item.partition("=")
    if key in _WORDS:
        return key, value
    try:
        return key, float(value)
    except ValueError:
        raise PolicyError(f"policy = {text!r} is not possible: {item!r} must be name=number") from None


def _published_legs(scenario: Scenario) -> tuple[tuple[float, float], ...]:
    if scenario.name not in rules.PUBLISHED_LEGS:
        known = ", ".join(rules.PUBLISHED_LEGS)
        raise PolicyError(
            f"policy = 'legs' is not possible: no legs were published for {scenario.name}; known: {known}"
        )
    return rules.PUBLISHED_LEGS[scenario.name]
