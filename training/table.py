"""Evaluations as tables for the terminal and for Markdown."""

from __future__ import annotations

from collections.abc import Callable

from rich.box import SIMPLE
from rich.table import Table

from training.evaluate import Evaluation, Verdict
from training.statistics import Estimate

_HEADLINE = "log range bound"
_WIDE = 110
_LEADING = 6
"""Columns that an 80-character terminal has room for."""


def _interval(estimate: Estimate, digits: int, scale: float = 1.0) -> str:
    value, low, high = (scale * number for number in (estimate.value, estimate.low, estimate.high))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


COLUMNS: dict[str, Callable[[Verdict], str]] = {
    "policy": lambda v: v.policy,
    _HEADLINE: lambda v: _interval(v.log_range_bound, 3),
    "end error, %": lambda v: _interval(v.end_error, 2, 100.0),
    "time to 10 %, s": lambda v: _interval(v.time_to_10, 0),
    "violations, %": lambda v: _interval(v.violations, 1, 100.0),
    "lost, %": lambda v: _interval(v.lost, 1, 100.0),
    "RMS / bound": lambda v: f"{v.efficiency:.2f}",
    "ANEES": lambda v: f"{v.anees:.2f}" if v.anees < 100.0 else f"{v.anees:.0e}",
    "ms/decision": lambda v: f"{v.milliseconds_per_decision:.4f}",
}
"""Columns of every table, in order."""


def title(evaluation: Evaluation) -> str:
    """What the table shows."""
    first, last = evaluation.seed, evaluation.seed + evaluation.episodes - 1
    tracker = type(evaluation.scenario.tracker).__name__
    return f"{evaluation.scenario.name}: {evaluation.episodes} episodes, seeds {first}–{last}, tracker {tracker}"


def notes(evaluation: Evaluation) -> str:
    """How to read the columns."""
    low, high = evaluation.anees_band
    return (
        "Log range bound: mean over time of ln(σ_r / r) of the Cramér–Rao bound along the path flown, lower is better. "
        "End error: median position error over range. "
        f"{_violations(evaluation.scenario.episode.min_range)} "
        "Brackets: 95 % intervals (paired bootstrap; Wilson for rates). "
        f"ANEES per state of a consistent tracker: {low:.2f}–{high:.2f}."
    )


def _violations(min_range: float) -> str:
    return f"Violations: true range below {min_range / 1e3:g} km at any time." if min_range else "No keep-out range."


def rich_table(evaluation: Evaluation, width: int) -> Table:
    """The evaluation for a terminal of a given width, best policy first; narrow ones get the leading columns."""
    names = list(COLUMNS) if width >= _WIDE else list(COLUMNS)[:_LEADING]
    table = Table(
        title=title(evaluation),
        caption=notes(evaluation),
        caption_justify="left",
        box=SIMPLE,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    for name in names:
        heading = name.replace(", ", ",\n").replace("time to ", "time to\n")
        table.add_column(heading, justify="left" if name == "policy" else "right", no_wrap=name != "policy")
    for verdict in ranked(evaluation):
        table.add_row(*(COLUMNS[name](verdict).replace(" [", "\n[").replace(", ", ",") for name in names))
    return table


def markdown_table(evaluation: Evaluation) -> str:
    """The evaluation as a Markdown table, best policy first."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "|".join([":--"] + ["--:"] * (len(COLUMNS) - 1)) + "|"]
    for verdict in ranked(evaluation):
        lines.append("| " + " | ".join(write(verdict) for write in COLUMNS.values()) + " |")
    return "\n".join(lines) + "\n"


def ranked(evaluation: Evaluation) -> list[Verdict]:
    """The verdicts, best log range bound first."""
    return sorted(evaluation.verdicts, key=lambda verdict: verdict.log_range_bound.value)
