"""What every policy is, as plain data: what it does, what it can be told, and which scenarios it can fly."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, replace

from agents import PLANNER_NAMES, RULE_NAMES, TruthKnowing, find_policy, load, shipped_agents
from agents.catalogue import AGENT, LEARNED, meaning_of, parameters_of
from agents.parameters import Parameter
from agents.shipped import learned
from passloc_env.errors import InputError
from passloc_env.scenarios import SCENARIOS

RUN = "FOLDER"
"""Stands for the path of a run folder or agent file."""


@dataclass(frozen=True)
class Described:
    """A policy.

    Attributes:
        name: as commands take it.
        does: what, in a line.
        scenarios: names of those that it can fly; of a shipped agent, of those that it is made for.
        knows_truth: whether it is told what nobody can know.
        parameters: what it can be told.
        like: the policy before it that can be told just the same; empty without one.
    """

    name: str
    does: str
    scenarios: tuple[str, ...]
    knows_truth: bool = False
    parameters: dict[str, Parameter] = field(default_factory=dict)
    like: str = ""

    @property
    def flies(self) -> str:
        """Its scenarios, or the few that are not among them."""
        others = [name for name in SCENARIOS if name not in self.scenarios]
        if len(others) < len(self.scenarios):
            return f"all but {', '.join(others)}" if others else "all"
        return ", ".join(self.scenarios) or "those that it was trained for"

    @property
    def written_out(self) -> str:
        """Its name with every parameter that has one default everywhere: the same policy, written at length."""
        fixed = (f"{name}={told.shown}" for name, told in self.parameters.items() if not told.kind.by_default)
        return ":".join([self.name, *fixed])


def described_rules() -> list[Described]:
    """Every rule."""
    return [_by_recipe(name) for name in RULE_NAMES]


def described_planners() -> list[Described]:
    """Every planner."""
    described: list[Described] = []
    for name in PLANNER_NAMES:
        parameters = parameters_of(name)
        like = next((other.name for other in described if other.parameters == parameters), "")
        described.append(replace(_by_recipe(name), like=like))
    return described


def described_agents() -> list[Described]:
    """Every way to name an agent."""
    return [
        Described(LEARNED, _line(learned), _flown(LEARNED)),
        *(_shipped(name) for name in shipped_agents()),
        Described(RUN, "The agent in a run folder, or of one of its two files, by its path.", ()),
    ]


def _shipped(name: str) -> Described:
    agent = load(name).agent
    trained = f"trained on {agent.scenario.name}, whose tracker was {type(agent.scenario.tracker).__name__}"
    return Described(AGENT + name, f"A shipped agent, {trained}.", agent.flies)


def _by_recipe(name: str) -> Described:
    scenarios = _flown(name)
    knows = isinstance(find_policy(name, SCENARIOS[scenarios[0]]), TruthKnowing)
    return Described(name, meaning_of(name), scenarios, knows, parameters_of(name))


def _flown(name: str) -> tuple[str, ...]:
    """The scenarios that a policy can be had for."""
    return tuple(scenario.name for scenario in SCENARIOS.values() if _can_be_had(name, scenario.name))


def _can_be_had(name: str, scenario: str) -> bool:
    try:
        find_policy(name, SCENARIOS[scenario])
    except InputError:
        return False
    return True


def _line(of: object) -> str:
    return (inspect.getdoc(of) or "").partition("\n")[0]
