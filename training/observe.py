"""What can be known along a path: printed, drawn as a map, saved as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from agents import find_policy
from passloc_env.layout import StateLayout
from passloc_env.survey import Survey
from training.arguments import check_seed, free_path, parse_overrides, picture_path, read_scenario
from training.commands import Observe
from training.observability_pictures import draw_survey
from training.progress import console

_INSTANTS = 8
"""Rows of the printed table."""

_BLIND = 1e12
"""A condition above this is rounding: the direction is not seen at all."""


def observe(arguments: Observe) -> Survey:
    """Fly one episode, say what it lets one know, and draw it."""
    scenario = read_scenario(arguments.scenario).override(parse_overrides(arguments.override))
    check_seed(arguments.seed)
    policy = find_policy(arguments.policy, scenario)
    results = None if arguments.json is None else free_path(arguments.json)
    picture = _picture(arguments.out, scenario.name, policy.name)
    survey = Survey(scenario.override(dict(policy.overrides)), policy.act, arguments.seed)
    title = f"{scenario.name}, flown by {policy.name}, seed {arguments.seed}"
    console.print(_report(survey, title))
    console.print(_verdict(survey), highlight=False, soft_wrap=True)
    draw_survey(survey, title, picture)
    console.print(f"map of the bound over emitter positions: {picture}", highlight=False, soft_wrap=True)
    if results is not None:
        results.write_text(json.dumps(_data(survey, policy.name), indent=2, ensure_ascii=False) + "\n", "utf-8")
    return survey


def _picture(wanted: Path | None, scenario: str, policy: str) -> Path:
    if wanted is not None:
        return picture_path(wanted)
    folder = Path("runs") / "observe"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{scenario}-{policy.replace(' ', '-').replace('°', '')}.png"


def _report(survey: Survey, title: str) -> Table:
    """The bound at a few times."""
    table = Table(title=title, title_justify="left")
    for name in ("time, s", "range, km", "bound on position, m", "bound / range, %"):
        table.add_column(name, justify="right")
    for k in np.unique(np.linspace(0, len(survey.time) - 1, _INSTANTS).round().astype(int)):
        away, bound = survey.range[k], survey.position_bound[k]
        table.add_row(f"{survey.time[k]:g}", f"{away / 1e3:.2f}", f"{bound:.4g}", f"{100.0 * bound / away:.3g}")
    return table


def _verdict(survey: Survey) -> str:
    """Rank, condition and weakest direction."""
    report = survey.rank()
    rank, condition = int(report.rank[0]), float(report.condition[0])
    words = "unbounded" if condition > _BLIND else f"{condition:.3g}"
    return (
        f"{len(survey.time)} measurements determine {rank} of {survey.layout.size} states; condition {words}, "
        "the state in units of the prior's deviations\n"
        f"weakest direction: {_direction(report.weakest[:, 0], survey.layout)}"
    )


def _direction(vector: np.ndarray, layout: StateLayout) -> str:
    """A direction in state units, what matters of it."""
    size = np.abs(vector) / np.abs(vector).max()
    units = _units(layout)
    return ", ".join(
        f"{name} {value:+.3g} {unit}".rstrip()
        for name, value, unit, share in zip(layout.names, vector, units, size, strict=True)
        if share > 0.01
    )


def _units(layout: StateLayout) -> list[str]:
    """The unit of each state; nuisances are named by what they are."""
    kinematic = [unit for unit in ("m", "m/s", "m/s²")[: layout.order + 1] for _ in range(layout.dimension)]
    return kinematic + [""] * len(layout.nuisance)


def _data(survey: Survey, policy: str) -> dict[str, Any]:
    report = survey.rank()
    condition = float(report.condition[0])
    return {
        "scenario": survey.scenario.name,
        "policy": policy,
        "states": list(survey.layout.names),
        "rank": int(report.rank[0]),
        "condition": condition if condition < _BLIND else None,
        "weakest_direction": report.weakest[:, 0].tolist(),
        "gramian": survey.gramian.tolist(),
        "time": survey.time.tolist(),
        "range": survey.range.tolist(),
        "position_bound": survey.position_bound.tolist(),
    }
