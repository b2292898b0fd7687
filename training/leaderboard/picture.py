"""One picture per variant: everybody's score with its interval, best on top."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from passloc_env.rendering.colours import BLACK, BLUE, GREY, PURPLE, VERMILION
from training.evaluate import Evaluation, Verdict
from training.leaderboard.entrants import Entrant, Kind
from training.score import LOG_RANGE_BOUND, score_of
from training.statistics import Estimate
from training.table import ranked

COLOURS: dict[Kind, str] = {
    "learned": VERMILION,
    "planner": BLUE,
    "rule": GREY,
    "truth": PURPLE,
    "optimum": BLACK,
}
"""Okabe and Ito's colours, told apart by colour-blind eyes; markers tell the kinds apart too."""

_MARKERS: dict[Kind, str] = {"learned": "*", "planner": "s", "rule": "o", "truth": "^", "optimum": "D"}
_SIZES: dict[Kind, float] = {"learned": 12.0, "planner": 6.5, "rule": 6.5, "truth": 7.0, "optimum": 6.5}
_WORDS: dict[Kind, str] = {
    "learned": "learned agent",
    "planner": "planner",
    "rule": "rule",
    "truth": "planner told the truth",
    "optimum": "optimum for the true future",
}

MANY_VIOLATIONS = 0.01
"""Share of episodes with a violation beyond which a policy is drawn hollow."""

_SERIES = (
    (1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 2.2, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 2.0, 5.0),
    (1.0,),
)
"""Round numbers for the ticks of the upper axis within each power of ten, from many to few."""

_TICKS = 9
"""Most ticks of the upper axis."""


def draw(title: str, evaluation: Evaluation, found: Sequence[Entrant], path: Path) -> None:
    """Draw an evaluation, one row per policy.

    Args:
        title: of the picture.
        evaluation: what to draw.
        found: who flew, for what kind of policy each is.
        path: the picture.
    """
    kinds = {entrant.name: entrant.kind for entrant in found}
    verdicts = list(reversed(ranked(evaluation)))
    figure, axes = plt.subplots(figsize=(8.6, 1.9 + 0.29 * len(verdicts)), layout="constrained")
    score = score_of(evaluation.scenario)
    for row, verdict in enumerate(verdicts):
        estimate = score.cell(verdict)
        _draw_row(axes, row, estimate, kinds[verdict.policy], _hollow(verdict))
        if verdict.policy == evaluation.reference or kinds[verdict.policy] == "optimum":
            style = ":" if verdict.policy == evaluation.reference else "--"
            axes.axvline(estimate.value, color="0.45", lw=1.0, ls=style, zorder=0)
    axes.set_yticks(range(len(verdicts)), [verdict.policy for verdict in verdicts])
    axes.set_ylim(-0.7, len(verdicts) - 0.3)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(score.axis)
    axes.grid(axis="both", color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["left", "right"]].set_visible(False)
    if score is LOG_RANGE_BOUND:
        _percent_axis(axes)
    else:
        _plain_logarithmic_axis(axes)
    hollow = any(_hollow(verdict) for verdict in verdicts)
    shown = [kind for kind in COLOURS if kind in kinds.values()]
    handles = _legend(shown, hollow)
    # In rows of three, below the axes: all of it in one row would be wider than the picture.
    figure.legend(handles=handles, loc="outside lower center", ncols=min(3, len(handles)), frameon=False, fontsize=9)
    figure.suptitle(f"{title}: {evaluation.episodes} unseen episodes, 95 % intervals", fontsize=11)
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)


def _draw_row(axes: Axes, row: int, estimate: Estimate, kind: Kind, hollow: bool) -> None:
    colour = COLOURS[kind]
    axes.plot([estimate.low, estimate.high], [row, row], color=colour, lw=4.5, alpha=0.4, solid_capstyle="butt")
    face = "white" if hollow else colour
    axes.plot(estimate.value, row, _MARKERS[kind], ms=_SIZES[kind], color=colour, mfc=face, mew=1.3, zorder=3)


def _hollow(verdict: Verdict) -> bool:
    return verdict.violations.value > MANY_VIOLATIONS


def _plain_logarithmic_axis(axes: Axes) -> None:
    """A logarithmic axis with round numbers, few enough to be read."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    shown = next(ticks for ticks in _round(low, high) if len(ticks) <= _TICKS)
    axes.xaxis.set_major_locator(FixedLocator(shown))
    axes.xaxis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in shown]))
    axes.xaxis.set_minor_locator(NullLocator())


def _percent_axis(axes: Axes) -> None:
    """The same on top as a share of the range: the geometric mean over time of ``σ_r / r``."""
    low, high = axes.get_xlim()
    inside = next(ticks for ticks in _round(100.0 * np.exp(low), 100.0 * np.exp(high)) if len(ticks) <= _TICKS)
    top = axes.twiny()
    top.set_xlim(low, high)
    top.xaxis.set_major_locator(FixedLocator([float(np.log(value / 100.0)) for value in inside]))
    top.xaxis.set_major_formatter(FixedFormatter([f"{value:g} %" for value in inside]))
    top.xaxis.set_minor_locator(NullLocator())
    top.set_xlabel(r"the same as $\sigma_r / r$, geometric mean over time")
    top.spines[["left", "right"]].set_visible(False)


def _round(low: float, high: float) -> Iterator[list[float]]:
    """Round numbers between two positive limits, from many to few; none at last."""
    for series in _SERIES:
        ticks = np.outer(10.0 ** np.arange(-4, 7), series).ravel()
        yield [float(tick) for tick in ticks if low <= tick <= high]
    yield []


def _legend(shown: Sequence[Kind], hollow: bool) -> list[Line2D]:
    handles = [
        Line2D([], [], ls="", marker=_MARKERS[kind], color=COLOURS[kind], ms=_SIZES[kind], label=_WORDS[kind])
        for kind in shown
    ]
    if hollow:
        words = f"hollow: violations in more than {100.0 * MANY_VIOLATIONS:g} % of episodes"
        handles.append(Line2D([], [], ls="", marker="o", color=GREY, mfc="white", ms=6.5, mew=1.3, label=words))
    return handles
