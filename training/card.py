"""Scores for an agent's card: what it is worth on seeds that it never saw, so that everybody can check."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

from agents import LearnedPolicy, default_policies, find_policy
from agents.agent_file import AgentFile
from agents.shipped import ship
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import at_least_one, check_seed, parse_overrides
from training.commands import Card
from training.evaluate import Verdict
from training.judging import judge
from training.progress import console

REFERENCE = "circle"
"""Who flies the same seeds for comparison; where nothing can circle, the first rule of the scenario."""

_WRITTEN = ("log_range_bound", "violations", "end_error", "end_rms")
"""What a card says of a policy, as :class:`Verdict` calls it."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def card(arguments: Card) -> Path:
    """Judge an agent on each scenario, write the scores into its card, and ship it if it is given a name; its folder.

    Raises:
        AgentFileError: unreadable files, or an agent that does not fit a scenario.
        ScenarioError: an unknown field of a scenario, or an impossible value.
        InputError: an unknown scenario, impossible numbers, or a name that no folder should have.
    """
    check_seed(arguments.seed)
    at_least_one(episodes=arguments.episodes)
    if arguments.name and not _NAME.fullmatch(arguments.name):
        raise InputError(f"name = {arguments.name!r} is not possible: letters, digits, - and _ alone")
    agent = AgentFile.load(arguments.run)
    wanted = (
        [find(name.strip()) for name in arguments.scenarios.split(",")] if arguments.scenarios else [agent.scenario]
    )
    changes = parse_overrides(arguments.override)
    scenarios = [scenario.override(changes) for scenario in wanted]
    policies = [LearnedPolicy.load(arguments.run, scenario) for scenario in scenarios]
    agent.card["scores"] = [
        {"overrides": changes, **scores(policy, scenario, arguments.episodes, arguments.seed)}
        for policy, scenario in zip(policies, scenarios, strict=True)
    ]
    agent.card["flies"] = [scenario.name for scenario in scenarios]
    folder = arguments.run if arguments.run.is_dir() else arguments.run.parent
    agent.save(folder)
    if arguments.name:
        folder = ship(agent, arguments.name)
    for entry in agent.card["scores"]:
        console.print(_line(entry), highlight=False, soft_wrap=True)
    console.print(f"the card is in {folder}", highlight=False, soft_wrap=True)
    return folder


def reference_of(scenario: Scenario) -> str:
    """The rule that agents are compared with on a scenario, as the catalogue knows it."""
    rules = default_policies(scenario)
    return REFERENCE if REFERENCE in rules else rules[0]


def scores(policy: LearnedPolicy, scenario: Scenario, episodes: int, seed: int) -> dict[str, Any]:
    """What an agent came to on ``episodes`` unseen episodes from ``seed`` on, and the reference beside it.

    Estimates are a value with the ends of its 95 % interval; ``end_error`` is the median relative range error at the
    end, ``end_rms`` the RMS position error then, m, ``violations`` the share of episodes that entered the keep-out
    range at any time.
    """
    reference = reference_of(scenario)
    evaluation = judge(scenario, [find_policy(reference, scenario), policy], episodes, seed)
    other, own = evaluation.verdicts
    return {
        "scenario": scenario.name,
        "seed": seed,
        "episodes": episodes,
        "tracker": type(scenario.tracker).__name__,
        **_estimates(own, *_WRITTEN, "advantage"),
        "reference": {"policy": reference, **_estimates(other, *_WRITTEN)},
    }


def _estimates(verdict: Verdict, *names: str) -> dict[str, Any]:
    return {name: dataclasses.asdict(getattr(verdict, name)) for name in names}


def _line(entry: dict[str, Any]) -> str:
    own, reference = entry["log_range_bound"], entry["reference"]
    return (
        f"{entry['scenario']}: log range bound {own['value']:.3f} [{own['low']:.3f}, {own['high']:.3f}], "
        f"{reference['policy']} {reference['log_range_bound']['value']:.3f}; "
        f"violations {100.0 * entry['violations']['value']:.1f} %, "
        f"end error {100.0 * entry['end_error']['value']:.2f} %, RMS {entry['end_rms']['value']:.0f} m"
    )
