"""What can be known along a path: printed, drawn as a map, saved as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from agents import find_policy
from passloc_env.layout import StateLayout
from passloc_env.linalg import diagonal
from passloc_env.nuisance import Nuisance, units_of
from passloc_env.scenarios import find
from passloc_env.survey import Survey
from training.arguments import check_seed, file_stem, free_path, parse_overrides, picture_path
from training.commands import Observe
from training.observability_pictures import draw_survey
from training.progress import console

_INSTANTS = 8
"""Rows of the printed table."""

_MATTERS = 0.05
"""Parts of a direction below this share of the largest are not printed."""

_BLIND = 1e12
"""A condition above this is rounding: the direction is not seen at all."""


def observe(arguments: Observe) -> dict[str, Any]:
    """Fly one episode, say what it lets one know, and draw it; what was said, as plain data."""
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    check_seed(arguments.seed)
    policy = find_policy(arguments.policy, scenario)
    picture = _picture(arguments.out, f"{scenario.name}-{policy.name}-{arguments.seed}")
    survey = Survey(scenario.override(dict(policy.overrides)), policy.act, arguments.seed)
    title = f"{scenario.name}, flown by {policy.name}, seed {arguments.seed}"
    console.print(_report(survey, title))
    console.print(_verdict(survey), highlight=False, soft_wrap=True)
    draw_survey(survey, title, picture)
    console.print(f"map of the bound over emitter positions: {picture}", highlight=False, soft_wrap=True)
    return _data(survey, policy.name)


def _picture(wanted: Path | None, name: str) -> Path:
    if wanted is not None:
        return picture_path(wanted)
    return free_path(Path("runs") / "observe" / f"{file_stem(name)}.png")


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
    """How much was heard; rank, condition and weakest direction."""
    report = survey.rank()
    rank, condition = int(report.rank[0]), float(report.condition[0])
    words = "unbounded" if condition > _BLIND else f"{condition:.3g}"
    lines = [
        f"{len(survey.time)} measurements determine {rank} of {survey.layout.size} states; condition {words}, "
        "the state in units of the prior's deviations"
    ]
    heard = _heard(survey)
    if heard < len(survey.time):
        nothing = "" if heard else "; the bound is the prior's"
        lines.insert(0, f"{heard} of {len(survey.time)} looks heard{nothing}")
    if heard:
        scale = np.sqrt(diagonal(survey.prior)[:, 0])
        direction = _direction(report.weakest[:, 0], scale, survey.layout, survey.simulation.models.bound_nuisances)
        lines.append(f"weakest direction, one prior deviation (σ) along it: {direction}")
    return "\n".join(lines)


def _heard(survey: Survey) -> int:
    """How many looks measured anything."""
    return int(survey.rows.any(axis=(1, 2, 3)).sum())


def _direction(vector: np.ndarray, scale: np.ndarray, layout: StateLayout, nuisances: Sequence[Nuisance]) -> str:
    """What matters of a direction in state units, in prior deviations ``scale`` and in state units, largest first."""
    shares, units = vector / scale, layout.units(units_of(nuisances))
    return ", ".join(
        f"{layout.names[row]} {shares[row]:+.2f}σ ({f'{vector[row]:.3g} {units[row]}'.strip()})"
        for row in np.argsort(-np.abs(shares), kind="stable")
        if abs(shares[row]) > _MATTERS * np.abs(shares).max()
    )


def _data(survey: Survey, policy: str) -> dict[str, Any]:
    report = survey.rank()
    condition = float(report.condition[0])
    return {
        "scenario": survey.scenario.name,
        "policy": policy,
        "states": list(survey.layout.names),
        "heard": _heard(survey),
        "rank": int(report.rank[0]),
        "condition": condition if condition < _BLIND else None,
        "weakest_direction": report.weakest[:, 0].tolist(),
        "gramian": survey.gramian.tolist(),
        "time": survey.time.tolist(),
        "range": survey.range.tolist(),
        "position_bound": survey.position_bound.tolist(),
    }
