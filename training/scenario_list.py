"""All scenarios at a glance, for the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.padding import Padding

from agents import PLANNER_NAMES, rules_for
from passloc_env.scenarios import SCENARIOS, environment_id
from training.scenario_pages import sensor_names, summary

_HEADINGS = ("scenario", "lasts", "decides each", "sensors")
_INDENT = (0, 0, 0, 4)


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
