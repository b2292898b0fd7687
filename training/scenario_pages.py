"""One page per scenario, written from the scenario itself: nothing on it is typed twice."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from agents import AgentFileError, agents_for, default_policies, find_policy, rules_for
from passloc_env.component import Component, specs
from passloc_env.distributions import Distribution
from passloc_env.fields import Part, Parts
from passloc_env.models import observation_names
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS, environment_id
from passloc_env.spaces import action_space
from training.commands import EVALUATION_SEED
from training.files import write_whole
from training.markdown import markdown
from training.scenario_words import sensor_names, story, summary

_LEARNED = "learned"
_FILMED_RULES = ("circle", "roll")
"""Of these the first that can be flown is filmed where no shipped agent can be."""


def write_pages(folder: Path) -> list[Path]:
    """Write ``NAME.md`` for every scenario and an index; what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    index = folder / "index.md"
    write_whole(index, index_page())
    written = [index]
    for name, scenario in SCENARIOS.items():
        path = folder / f"{name}.md"
        write_whole(path, page(scenario))
        written.append(path)
    return written


def index_page() -> str:
    """All scenarios in one table."""
    rows: list[tuple[str, ...]] = [
        (
            f"[`{environment_id(name)}`]({name}.md)",
            summary(scenario),
            sensor_names(scenario),
            f"{scenario.episode.duration:g} s",
            str(scenario.action_size),
        )
        for name, scenario in SCENARIOS.items()
    ]
    return f"# Scenarios\n\n{markdown(('id', 'what', 'sensors', 'episode', 'actions'), rows)}\n"


def film_name(scenario: Scenario) -> str:
    """The file of a scenario's film, beside its page."""
    return f"{scenario.name}.gif"


def pilot(scenario: Scenario) -> str:
    """Who flies in the film, as commands name it: the shipped agent, or a rule where none fits the scenario."""
    try:
        find_policy(_LEARNED, scenario)
    except AgentFileError:
        return next(rule for rule in _FILMED_RULES if rule in rules_for(scenario))
    return _LEARNED


def page(scenario: Scenario) -> str:
    """Story, film, actions, observation, rewards, ends, and every number of a scenario."""
    episode = scenario.episode
    keep_out = f"entering {episode.min_range:g} m of the emitter" if episode.min_range else "nothing but a lost track"
    parts = [
        f"# {environment_id(scenario.name)}",
        *story(scenario),
        "## Watch it",
        *_film(scenario),
        "## Actions",
        f"`Box(-1, 1, {action_space(scenario).shape}, float32)`, one decision each {episode.interval:g} s:",
        _list(_commands(scenario)),
        "## Observation",
        f"`Box(-10, 10, ({len(observation_names(scenario))},), float32)`, the belief in the frame of its own line of "
        "sight:",
        markdown(("row", "feature"), [(str(row), name) for row, name in enumerate(observation_names(scenario))]),
        "## Rewards",
        markdown(("term", "weight"), [(term.name, f"{term.weight:g}") for term in scenario.reward]),
        "## Episode end",
        f"*Truncated* after {episode.steps} measurements ({episode.duration:g} s). *Terminated* by {keep_out}, or when "
        f"the relative error exceeds {episode.lost_error:g}.",
        "## Rules that fly it",
        ", ".join(f"`{name}`" for name in default_policies(scenario)),
        f"How they compare: [leaderboard](../leaderboard/index.md#{scenario.name.lower()}).",
        "## Everything it is made of",
        markdown(("field", "value", "unit", "meaning"), list(_fields(scenario, ""))),
    ]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def _film(scenario: Scenario) -> tuple[str, str, str]:
    """The film, who flies in it, and how to fly it again."""
    name = pilot(scenario)
    if name == _LEARNED:
        who = f"the shipped agent `{agents_for(scenario.name)[0]}`"
    else:
        who = f"the rule `{name}`; no shipped agent is for this scenario as it stands"
    return (
        f"![{scenario.name}, flown by {name}: tracks, belief and bound]({film_name(scenario)})",
        f"*Seed {EVALUATION_SEED}, flown by {who}.* Again, in full length:",
        f"```sh\npassloc replay {scenario.name} --policy {name} --seed {EVALUATION_SEED} "
        f"--gif runs/{film_name(scenario)}\n```",
    )


def _commands(scenario: Scenario) -> Iterator[str]:
    for index, platform in enumerate(scenario.platforms):
        if platform.controls == 1:
            control = getattr(platform, "control", "command")
            yield f"platform {index}: {'heading relative to the line of sight' if control == 'heading' else control}"
        elif platform.controls:
            yield f"platform {index}: body rates (roll, pitch, yaw)"


def _fields(component: Component, where: str) -> Iterator[tuple[str, str, str, str]]:
    """Every field of a component and its parts: dotted name, value, unit, meaning."""
    for name, spec in specs(type(component)).items():
        value, path = getattr(component, name), f"{where}{name}"
        if isinstance(spec, Part):
            yield f"**{path}**", f"**{type(value).__name__}**", "", spec.doc
            yield from _fields(value, f"{path}.")
        elif isinstance(spec, Parts):
            for index, item in enumerate(value):
                yield f"**{path}.{index}**", f"**{type(item).__name__}**", "", spec.doc
                yield from _fields(item, f"{path}.{index}.")
        else:
            yield path, _value(value), spec.unit, spec.doc


def _value(value: Any) -> str:
    if isinstance(value, Distribution):
        settings = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))  # type: ignore[arg-type]
        inside = ", ".join(f"{name}={_value(setting)}" for name, setting in settings if setting is not False)
        return f"{type(value).__name__}({inside})"
    if isinstance(value, tuple):
        return ", ".join(map(_value, value)) or "–"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _list(items: Iterable[str]) -> str:
    return "\n".join(f"- {item}" for item in items)
