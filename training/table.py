"""Evaluations as tables for the terminal and for Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from rich.box import SIMPLE
from rich.table import Table

from training.evaluate import Evaluation, Verdict
from training.markdown import RIGHT, markdown
from training.score import score_of
from training.statistics import Estimate

_POLICY, _DIFFERENCE, _CONSISTENCY = "policy", "difference", "ANEES"

Column = Callable[[Verdict], str]


def with_interval(estimate: Estimate, digits: int, scale: float = 1.0) -> str:
    """A value times a scale and, in brackets, its interval."""
    shown = estimate.scaled(scale)
    return f"{shown.value:.{digits}f} [{shown.low:.{digits}f}, {shown.high:.{digits}f}]"


def _digits(value: float) -> int:
    """Decimals that show three digits of a length, at most three."""
    return min(3, max(0, 2 - math.floor(math.log10(value)))) if 0.0 < value < math.inf else 0


COLUMNS: dict[str, Column] = {
    _POLICY: lambda v: v.policy,
    "log range bound": lambda v: with_interval(v.log_range_bound, 3),
    "end error, %": lambda v: with_interval(v.end_error, 2, 100.0),
    "end error, m": lambda v: with_interval(v.end_position_error, _digits(v.end_position_error.value)),
    "time to 10 %, s": lambda v: with_interval(v.time_to_10, 0),
    "violations, %": lambda v: with_interval(v.violations, 1, 100.0),
    "lost, %": lambda v: with_interval(v.lost, 1, 100.0),
    "RMS / bound": lambda v: f"{v.efficiency:.2f}",
    _CONSISTENCY: lambda v: f"{v.anees:.2f}" if v.anees < 100.0 else f"{v.anees:.0e}",
    "ms/decision": lambda v: f"{v.milliseconds_per_decision:.4f}",
}
"""Columns of every table, in order; :func:`columns_of` adds those that some tables have."""

_DISPENSABLE = ("ms/decision", _CONSISTENCY, "RMS / bound", "lost, %", "time to 10 %, s", "end error, m")
"""What a narrow terminal does without first, in this order: who wins by violations is to be seen in any."""


def difference(verdict: Verdict) -> str:
    """How far a policy's log range bound lies from the reference's, paired."""
    return with_interval(verdict.advantage, 3)


def columns_of(evaluation: Evaluation) -> dict[str, Column]:
    """The columns of an evaluation's tables, in order: after the headline what sorts, then what sets apart."""
    score = score_of(evaluation.scenario)
    columns = dict(list(COLUMNS.items())[:2])
    if score.column not in COLUMNS:
        columns[score.column] = lambda verdict: with_interval(score.cell(verdict), score.digits)
    if len(evaluation.verdicts) > 1:
        columns[_DIFFERENCE] = difference
    return columns | COLUMNS


def title(evaluation: Evaluation) -> str:
    """What the table shows."""
    first, last = evaluation.seed, evaluation.seed + evaluation.episodes - 1
    tracker = type(evaluation.scenario.tracker).__name__
    return f"{evaluation.scenario.name}: {evaluation.episodes} episodes, seeds {first}–{last}, tracker {tracker}"


def notes(evaluation: Evaluation, columns: Sequence[str] | None = None) -> str:
    """How to read the columns, all by default."""
    columns = tuple(columns_of(evaluation)) if columns is None else columns
    scenario, (low, high) = evaluation.scenario, evaluation.anees_band
    away = "range" if len(scenario.platforms) == 1 else f"the range of platform {scenario.own_ship}"
    sentences = [
        "Log range bound: mean over time of ln(σ_r / r) of the Cramér–Rao bound along the path flown, lower is better."
    ]
    if any(sensor.noise_law == "uniform" for sensor in scenario.sensors):
        sentences.append("Uniform noise has no such bound: it is that of normal noise of the same variance.")
    if _DIFFERENCE in columns:
        sentences.append(
            f"Difference: log range bound minus that of {evaluation.reference}, paired; negative is better."
        )
    sentences.append(f"End error: median position error, over {away} and in metres.")
    sentences += filter(None, [score_of(scenario).remark])
    sentences.append(_violations(scenario.episode.min_range))
    sentences.append("Brackets: 95 % intervals (paired bootstrap; Wilson for rates).")
    if _CONSISTENCY in columns:
        sentences.append(f"ANEES per state of a consistent tracker: {low:.2f}–{high:.2f}.")
    return " ".join(sentences)


def _violations(min_range: float) -> str:
    return f"Violations: true range below {min_range / 1e3:g} km at any time." if min_range else "No keep-out range."


def rich_table(evaluation: Evaluation, width: int) -> Table:
    """The evaluation for a terminal of a given width, best policy first; narrow ones get fewer columns."""
    every = columns_of(evaluation)
    columns = {name: _column(name, write, evaluation) for name, write in every.items()}
    while len(columns) > 1 and sum(_width(name, cells) + 1 for name, cells in columns.items()) > width + 1:
        del columns[_least(columns, score_of(evaluation.scenario).column)]
    table = Table(
        title=title(evaluation),
        caption=notes(evaluation, tuple(columns)) + _no_room([name for name in every if name not in columns]),
        caption_justify="left",
        box=SIMPLE,
        padding=0,
        pad_edge=False,
        show_edge=False,
    )
    for name, cells in columns.items():
        plain, least = name != _POLICY, _width(name, cells)
        table.add_column(cells[0], justify="right" if plain else "left", no_wrap=plain, min_width=least)
    for row in zip(*(cells[1:] for cells in columns.values()), strict=True):
        table.add_row(*row)
    return table


def _least(columns: Iterable[str], score: str) -> str:
    """The column that can be done without best: a dispensable one that is not the score, or the last."""
    names = tuple(columns)
    return next((name for name in _DISPENSABLE if name in names and name != score), names[-1])


def _no_room(hidden: Sequence[str]) -> str:
    """A sentence that says which columns are missing, if any."""
    return f" No room for {'; '.join(hidden)}: widen the terminal or use --json." if hidden else ""


def _column(name: str, write: Column, evaluation: Evaluation) -> list[str]:
    """Heading and cells, intervals on a line of their own."""
    heading = name.replace(", ", ",\n").replace("time to ", "time to\n")
    cells = [write(verdict) for verdict in ranked(evaluation)]
    return [heading, *(cell.replace(" [", "\n[").replace(", ", ",") for cell in cells)]


def _width(name: str, cells: list[str]) -> int:
    """The longest line of a column; names of policies may be broken between words."""
    return max(len(line) for cell in cells for line in (cell.split() if name == _POLICY else cell.split("\n")))


def markdown_table(evaluation: Evaluation) -> str:
    """The evaluation as a Markdown table, best policy first."""
    columns = columns_of(evaluation)
    rows = [[write(verdict) for write in columns.values()] for verdict in ranked(evaluation)]
    return markdown(tuple(columns), rows, RIGHT) + "\n"


def ranked(evaluation: Evaluation) -> list[Verdict]:
    """The verdicts, best score first, those without one last."""
    score = score_of(evaluation.scenario)

    def order(verdict: Verdict) -> tuple[bool, float]:
        value = score.of(verdict).value
        return math.isnan(value), value

    return sorted(evaluation.verdicts, key=order)
