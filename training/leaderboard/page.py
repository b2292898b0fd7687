"""The board as a page: a summary, then one section per variant with its table and its picture."""

from __future__ import annotations

import functools
import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from training.commands import EVALUATION_SEED, Leaderboard
from training.evaluate import Evaluation, Verdict
from training.files import write_whole
from training.leaderboard.picture import MANY_VIOLATIONS, draw
from training.markdown import RIGHT, markdown
from training.score import END_RMS, LOG_RANGE_BOUND, score_of
from training.statistics import Bootstrap
from training.table import Column, columns_of, difference, notes, ranked, title, with_interval

if TYPE_CHECKING:
    from training.leaderboard.board import Section

_HEAD = """# Leaderboard

Everybody flies the same unseen episodes of every scenario. The score of most is the log range bound: the mean over time
of ln(σ_r / r), where σ_r is the Cramér–Rao bound on the range along the path flown and r the true range. Lower is
better: 0.1 less is a range that could be known 10 % better all the time. It judges the path alone; what the tracker
made of it is in the end error. The own-ship cases of the literature are scored by the last estimate, its position error
RMS over the episodes, and CrossFix, which has no range to speak of, by the median of the same.

*Rules, planners and learned agents* see the belief and nothing else. Policies with *truth* in their name are told what
nobody can know: a planner with *-truth* knows where the emitter is now, the *trajectory optimum* all of its future.
They show how much room is left; the optimum is heuristic, found by gradient from several starts, and minimises the
bound: the mean log range bound, or the bound on the last position where that is the score. Brackets are 95 %
intervals, paired where one policy is compared with another. In the pictures the dotted line is the reference and the
dashed one the optimum. Hollow markers: violations of the keep-out in more than {low:g} % of the episodes; such a score
was bought by flying where one must not.

A case of the literature is one geometry. *A family around it* has half to twice its range and speed, any bearing and
course, any own heading, and 0.7 to 1.5 times its noise; agents are trained on families, never on the case."""

_SHARED = ("end error, %", "violations, %", "lost, %", "RMS / bound", "ANEES", "ms/decision")
_PERCENTILES = {"median": 50, "p95": 95, "p99": 99}


def write(sections: Sequence[Section], arguments: Leaderboard) -> list[Path]:
    """Write ``index.md`` and a picture per variant; what was written."""
    written = []
    for section in sections:
        path = arguments.out / f"{section.variant.name}.png"
        draw(section.variant.title, section.evaluation, section.entrants, path)
        written.append(path)
    page = arguments.out / "index.md"
    parts = [
        _HEAD.format(low=100.0 * MANY_VIOLATIONS),
        f"```sh\n{_command(arguments)}\n```",
        _summary(sections),
        *(_section(part) for part in sections),
    ]
    write_whole(page, "\n\n".join(parts) + "\n")
    return [page, *written]


def _summary(sections: Sequence[Section]) -> str:
    """The best policy of each variant that knows no more than it may and keeps out of where it must not be."""
    header = ("scenario", "score", "best policy", "its score", "reference", "optimum", "of the room")
    rows = [_summary_row(section) for section in sections]
    low = 100.0 * MANY_VIOLATIONS
    explained = (
        f"Best of those that see the belief alone and violate in at most {low:g} % of the episodes, chosen on these "
        f"very episodes. Of the room: how much of the way from the reference to the optimum it goes."
    )
    return f"{markdown(header, rows, RIGHT)}\n\n*{explained}*"


def _summary_row(section: Section) -> tuple[str, ...]:
    kinds = {entrant.name: entrant.kind for entrant in section.entrants}
    verdicts = ranked(section.evaluation)
    fair = [
        verdict
        for verdict in verdicts
        if kinds[verdict.policy] in ("rule", "planner", "learned") and verdict.violations.value <= MANY_VIOLATIONS
    ]
    score, reference = score_of(section.evaluation.scenario), section.evaluation.reference
    cells = {verdict.policy: score.cell(verdict) for verdict in verdicts}
    optimum = next((cells[name].value for name in cells if kinds[name] == "optimum"), math.nan)
    link = f"[{section.variant.title}](#{_anchor(section.variant.title)})"
    known = "–" if math.isnan(optimum) else f"{optimum:.{score.digits}f}"
    referred = f"{reference} {cells[reference].value:.{score.digits}f}"
    if not fair:
        return link, score.column, "none", "–", referred, known, "–"
    best = cells[fair[0].policy]
    room = cells[reference].value - optimum
    # An error is no bound: the path of least bound need not be the one of least error.
    share = score is LOG_RANGE_BOUND and room > 0.0
    part = f"{100.0 * (cells[reference].value - best.value) / room:.0f} %" if share else "–"
    return link, score.column, fair[0].policy, with_interval(best, score.digits), referred, known, part


def _section(section: Section) -> str:
    evaluation, variant = section.evaluation, section.variant
    columns = _columns(evaluation)
    rows = [tuple(column(verdict) for column in columns.values()) for verdict in ranked(evaluation)]
    remarks = [notes(evaluation, tuple(columns)), *section.notes]
    parts = [
        f"## {variant.title}",
        f"{title(evaluation)}.",
        f"![Score of every policy on {variant.title}]({variant.name}.png)",
        markdown(tuple(columns), rows, RIGHT),
        f"*{' '.join(remarks)}*",
    ]
    return "\n\n".join(parts)


def _columns(evaluation: Evaluation) -> dict[str, Column]:
    """The columns of a variant's table: its score and, where that is the RMS error, the percentiles come first."""
    every, score = columns_of(evaluation), score_of(evaluation.scenario)
    columns: dict[str, Column] = {name: every[name] for name in ("policy", score.column)}
    if score is END_RMS:
        bootstrap = Bootstrap(evaluation.episodes)
        for name, percent in _PERCENTILES.items():
            columns[f"{name}, km"] = functools.partial(_kilometres, evaluation, bootstrap, percent)
    columns[LOG_RANGE_BOUND.column] = every[LOG_RANGE_BOUND.column]
    columns[f"minus {evaluation.reference}'s"] = difference
    return columns | {name: every[name] for name in _SHARED}


def _kilometres(evaluation: Evaluation, bootstrap: Bootstrap, percent: float, verdict: Verdict) -> str:
    errors = evaluation.scores[verdict.policy].end_position_error
    return with_interval(bootstrap.estimate(errors, functools.partial(np.percentile, q=percent)), 3, 1e-3)


def _anchor(heading: str) -> str:
    """How Markdown links to a heading."""
    return "".join(letter for letter in heading.lower().replace(" ", "-") if letter.isalnum() or letter in "-_")


def _command(arguments: Leaderboard) -> str:
    """What to type to make this page again."""
    words = ["passloc", "leaderboard", "--episodes", str(arguments.episodes), "--out", arguments.out.as_posix()]
    if arguments.seed != EVALUATION_SEED:
        words += ["--seed", str(arguments.seed)]
    for option in ("scenarios", "policies"):
        if getattr(arguments, option):
            words += [f"--{option}", getattr(arguments, option)]
    return shlex.join(words)
