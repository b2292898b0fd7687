"""All scenarios at a glance, for the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.padding import Padding

from agents import PLANNER_NAMES, rules_for, shipped_agents
from passloc_env.scenarios import SCENARIOS, environment_id
from training.arguments import writable_folder
from training.commands import List
from training.progress import console
from training.scenario_words import sensor_names, summary

_HEADINGS = ("scenario", "lasts", "decides each", "sensors")
_INDENT = (0, 0, 0, 4)


def list_known(arguments: List) -> dict[str, Any]:
    """List the scenarios or, where they are asked for, the policies."""
    if arguments.policies:
        from training.policy_list import list_policies

        return list_policies(arguments)
    return list_scenarios(arguments)


def list_scenarios(arguments: List) -> dict[str, Any]:
    """Print the scenarios, and write their pages where that is asked for; what was printed, as plain data."""
    if arguments.pages is not None:
        from training.scenario_films import write_films
        from training.scenario_pages import write_pages

        folder = writable_folder(arguments.pages)
        write_pages(folder)
        write_films(folder)
    print_scenarios(console)
    return {
        environment_id(name): {
            "duration": scenario.episode.duration,
            "interval": scenario.episode.interval,
            "sensors": [type(sensor).__name__ for sensor in scenario.sensors],
            "summary": summary(scenario),
            "rules": list(rules_for(scenario)),
            "planners": list(PLANNER_NAMES),
        }
        for name, scenario in SCENARIOS.items()
    }


def print_scenarios(console: Console) -> None:
    """Each scenario's figures in a line and what it is about below; then the rules that can fly them."""
    rows = [
        (
            environment_id(name),
            f"{scenario.episode.duration:g} s",
            f"{scenario.episode.interval:g} s",
            sensor_names(scenario),
        )
        for name, scenario in SCENARIOS.items()
    ]
    name, lasts, decides, _ = (max(map(len, column)) for column in zip(_HEADINGS, *rows, strict=True))
    stories = ["", *map(summary, SCENARIOS.values())]
    for row, story in zip((_HEADINGS, *rows), stories, strict=True):
        line = f"{row[0]:{name}}  {row[1]:>{lasts}}  {row[2]:>{decides}}  {row[3]}"
        console.print(line, highlight=False, soft_wrap=True)
        if story:
            console.print(Padding(story, _INDENT), highlight=False)
    followed: dict[tuple[str, ...], list[str]] = {}
    for scenario in SCENARIOS.values():
        followed.setdefault(rules_for(scenario), []).append(scenario.name)
    for rules, names in followed.items():
        console.print(f"rules for {', '.join(names)}:", highlight=False, soft_wrap=True)
        console.print(Padding(", ".join(rules), _INDENT), highlight=False)
    console.print(f"planners: {', '.join(PLANNER_NAMES)}", highlight=False)
    agents = ", ".join(f"agent:{name}" for name in shipped_agents())
    console.print(f"shipped agents: {agents}", highlight=False)
    console.print(Padding("learned stands for the one made for the scenario", _INDENT), highlight=False)
    console.print("what each does, and its parameters: passloc list --policies", highlight=False)
