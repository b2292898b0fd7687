"""Shen et al. 2014 (paper 004): cross fixes with positive ranges, from three bearings that err by up to ±45°.

Target and stations are uniform in the unit square and errors are counted in sides of it: the one reference length under
which the paper's table comes out. All methods see the same trials.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from passloc_env.angles import bearing_of, direction
from passloc_env.arrays import Array
from passloc_env.rendering.colours import BOUND, EMITTER, ESTIMATE, OBSERVER, ORANGE, PURPLE
from passloc_env.tracking.cross_fix import (
    least_squares,
    maximum_likelihood,
    positive_range_least_squares,
    tangent_least_squares,
)
from training.papers.moving_cross_fix import LIMITS, reproduce_in_the_environment
from training.papers.reproduction import Reproduction, Verdict, holds
from training.statistics import Estimate, rate

TRIALS = 200_000
STATIONS = 3
WIDEST = math.pi / 4
"""Largest error of a bearing, rad."""

_PAPER_TRIALS = 10_000
_DEVIATIONS = 2.73
"""Standard deviations by which one of eight numbers may be off, for 95 % that none of them is."""

_ABOUT = 0.05
"""How far from "about 30 %" a share may be."""

_EQUAL_TIME = 1.2
"""Ratio of two times that still counts as equal."""

_TIMED, _ROUNDS = 20_000, 7
"""Fixes in a timed batch, and how often every method is timed, taking turns."""

_CELLS = 24
"""Cells along each side of the square, for the places that fit."""

_CHUNK = 10_000
"""Trials held against the cells at once."""

_MEAN_DISTANCE = (2.0 + math.sqrt(2.0) + 5.0 * math.asinh(1.0)) / 15.0
"""Of two points uniform in the unit square."""


@dataclass(frozen=True)
class Trials:
    """Scenes of the paper's simulation.

    Attributes:
        stations: ``(2, M, N)``, sides.
        bearings: ``(M, N)``, rad.
        target: ``(2, N)``.
    """

    stations: Array
    bearings: Array
    target: Array

    @classmethod
    def drawn(cls, count: int, seed: int) -> Trials:
        """Independent trials."""
        rng = np.random.default_rng(seed)
        stations, target = rng.uniform(size=(2, STATIONS, count)), rng.uniform(size=(2, count))
        error = rng.uniform(-WIDEST, WIDEST, (STATIONS, count))
        return cls(stations, bearing_of(target[:, None] - stations) + error, target)

    def error(self, fix: Array) -> Array:
        """Distance of fixes ``(2, N)`` from the target ``(N,)``, sides."""
        return np.hypot(fix[0] - self.target[0], fix[1] - self.target[1])


@dataclass(frozen=True)
class Method:
    """A way to a fix, how it is drawn, and its row of the paper's Table 1."""

    name: str
    locate: Callable[[Array, Array], Array]
    colour: str
    paper: tuple[float, ...] | None = None
    style: str = "-"


def centre_of_the_square(stations: Array, bearings: Array) -> Array:
    """The guess ``(2, N)`` of somebody who knows the square and has no bearings."""
    return np.full((2, bearings.shape[1]), 0.5)


def mean_of_all_that_fits(stations: Array, bearings: Array) -> Array:
    """Mean ``(2, N)`` of the places in the square that have all bearings within 45°.

    No fix has a smaller mean square error; but this one knows the square and the law of the errors.
    """
    middles = (np.arange(_CELLS) + 0.5) / _CELLS
    fixes = []
    for first in range(0, bearings.shape[1], _CHUNK):
        part = slice(first, first + _CHUNK)
        (east, north), (sine, cosine) = stations[..., part], direction(bearings[:, part])
        total, count = np.zeros((2, east.shape[1])), np.zeros(east.shape[1])
        for place in np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2):
            x, y = place[0] - east, place[1] - north
            fits = (np.abs(cosine * x - sine * y) <= sine * x + cosine * y).all(axis=0)
            total += fits * place[:, None]
            count += fits
        fixes.append(np.where(count > 0, total / np.maximum(count, 1.0), 0.5))
    return np.concatenate(fixes, axis=1)


TANGENT = Method("tangent least squares (4)", tangent_least_squares, ORANGE)
LINES = Method("least squares (8)", least_squares, OBSERVER, (0.512, 0.688, 0.801, 0.864))
RAYS = Method("positive ranges (12)", positive_range_least_squares, EMITTER, (0.591, 0.772, 0.885, 0.939))
LIKELIHOOD = Method("maximum likelihood", maximum_likelihood, ESTIMATE)
METHODS = (TANGENT, LINES, RAYS, LIKELIHOOD)
YARDSTICKS = (
    Method("centre of the square, no bearings", centre_of_the_square, BOUND, style=":"),
    Method("mean of all that fits", mean_of_all_that_fits, BOUND, style="--"),
)


def reproduce(reproduction: Reproduction) -> None:
    """Table 1, figure 4 and what the paper says beside them; ``runs`` are trials."""
    trials = Trials.drawn(reproduction.runs_or(TRIALS), reproduction.seed)
    errors = {m.name: trials.error(m.locate(trials.stations, trials.bearings)) for m in METHODS + YARDSTICKS}
    times = _times(Trials.drawn(_TIMED, reproduction.seed + 1))
    for method in (LINES, RAYS):
        _claim_row(reproduction, method, errors[method.name])
    _claim_tradition(reproduction, errors)
    _claim_gain(reproduction, errors)
    _claim_negative_ranges(reproduction, trials)
    _claim_equivalence(reproduction, trials)
    _claim_time(reproduction, times)
    row = tuple(share.value for share in _row(errors[RAYS.name]))
    reproduce_in_the_environment(reproduction, row, len(errors[RAYS.name]))
    _tabulate(reproduction, errors, times)
    _tabulate_lengths(reproduction, errors)
    _draw_curves(reproduction, errors)
    _draw_false_fix(reproduction)


def _row(errors: Array) -> list[Estimate]:
    """A row of Table 1."""
    return [rate(errors <= limit) for limit in LIMITS]


def _deviations(measured: Estimate, paper: float, trials: int) -> float:
    """How many standard deviations lie between two shares, taken from all trials of both experiments together."""
    share = (measured.value * trials + paper * _PAPER_TRIALS) / (trials + _PAPER_TRIALS)
    return abs(measured.value - paper) / math.sqrt(share * (1.0 - share) * (1.0 / trials + 1.0 / _PAPER_TRIALS))


def _agrees(errors: Array, paper: tuple[float, ...]) -> bool:
    """Whether a whole row does."""
    pairs = zip(_row(errors), paper, strict=True)
    return all(_deviations(measured, value, len(errors)) <= _DEVIATIONS for measured, value in pairs)


def _claim_row(reproduction: Reproduction, method: Method, errors: Array) -> None:
    assert method.paper is not None
    for limit, paper, measured in zip(LIMITS, method.paper, _row(errors), strict=True):
        apart = _deviations(measured, paper, len(errors))
        reproduction.claim(
            f"Table 1: P(error ≤ {limit:.0%}), {method.name}",
            paper,
            measured,
            holds(apart <= _DEVIATIONS),
            f"error over the side of the square; {apart:.1f} standard deviations of the paper's 10 000 trials and ours "
            f"apart, {_DEVIATIONS} allowed for eight numbers at once",
        )


def _claim_tradition(reproduction: Reproduction, errors: dict[str, Array]) -> None:
    assert LINES.paper is not None
    verdict = holds(_agrees(errors[TANGENT.name], LINES.paper))
    if verdict is Verdict.NOT_REPRODUCIBLE and _agrees(errors[LINES.name], LINES.paper):
        verdict = Verdict.REPRODUCED_IF
    reproduction.claim(
        "Table 1, row of least squares: the traditional method, from tangents (4)",
        " / ".join(f"{value:.3f}" for value in LINES.paper),
        " / ".join(f"{share.value:.3f}" for share in _row(errors[TANGENT.name])),
        verdict,
        "the row is that of sines and cosines (8); tangents do worse",
    )


def _claim_gain(reproduction: Reproduction, errors: dict[str, Array]) -> None:
    """Rays against lines in the same trials: differences are far more certain than either share."""
    assert LINES.paper is not None
    assert RAYS.paper is not None
    theirs = [rays - lines for rays, lines in zip(RAYS.paper, LINES.paper, strict=True)]
    gains, apart = [], []
    for limit, paper in zip(LIMITS, theirs, strict=True):
        gain = (errors[RAYS.name] <= limit).astype(float) - (errors[LINES.name] <= limit)
        # One trial more than there were, so that few that all agree are not taken for certainty.
        deviation = math.sqrt((np.square(gain).sum() + 1.0) / (len(gain) + 1.0))
        gains.append((gain.mean(), 1.96 * deviation / math.sqrt(len(gain))))
        apart.append(abs(paper - gain.mean()) / (deviation * math.sqrt(1.0 / len(gain) + 1.0 / _PAPER_TRIALS)))
    reproduction.claim(
        "positive ranges are more accurate than least squares: gain in P(error ≤ 30 / 40 / 50 / 60 %)",
        " / ".join(f"{gain:.3f}" for gain in theirs),
        " / ".join(f"{gain:.3f} ± {half:.3f}" for gain, half in gains),
        holds(all(gain > half for gain, half in gains)),
        "same trials for both, 95 % intervals; more accurate is read as a gain above zero at all four. The sizes are "
        + " / ".join(f"{deviations:.1f}" for deviations in apart)
        + " standard deviations of both experiments apart",
    )


def _claim_negative_ranges(reproduction: Reproduction, trials: Trials) -> None:
    fix = least_squares(trials.stations, trials.bearings)
    east, north = fix[:, None] - trials.stations
    sine, cosine = direction(trials.bearings)
    measured = rate((sine * east + cosine * north < 0.0).any(axis=0))
    reproduction.claim(
        "least squares (8) puts the target behind some station, r < 0, in about 30 % of the trials",
        0.3,
        measured,
        holds(abs(measured.value - 0.3) < _ABOUT),
        f"about is read as ± {_ABOUT:.0%}",
    )


def _claim_equivalence(reproduction: Reproduction, trials: Trials) -> None:
    def apart(count: int) -> tuple[Array, Array]:
        """Distance between the fixes of the first stations, and that of the fix from the origin."""
        given = trials.stations[:, :count], trials.bearings[:count]
        lines, tangents = least_squares(*given), tangent_least_squares(*given)
        return np.hypot(*(lines - tangents)), np.hypot(*lines)

    three, _ = apart(STATIONS)
    two, distance = apart(2)
    measured = rate(three > 0.01)
    reproduction.claim(
        "(8) is equivalent to (4): share of trials in which they differ by more than 1 % of the side",
        0.0,
        measured,
        holds(measured.value == 0.0),
        f"three stations, median difference {np.median(three):.3f} sides: (4) minimises Σ e²/cos² φ, (8) Σ e²; with "
        f"two stations both are the crossing, and differ by no more than {(two / (1.0 + distance)).max():.0e}",
    )


def _times(trials: Trials) -> dict[str, Array]:
    """Time per fix of each method, one value a round, µs; methods take turns so that all meet the same machine."""
    times: dict[str, list[float]] = {method.name: [] for method in METHODS}
    for _ in range(_ROUNDS):
        for method in METHODS:
            start = time.perf_counter()
            method.locate(trials.stations, trials.bearings)
            times[method.name].append((time.perf_counter() - start) / _TIMED * 1e6)
    return {name: np.array(values) for name, values in times.items()}


def _claim_time(reproduction: Reproduction, times: dict[str, Array]) -> None:
    ratio = times[RAYS.name] / times[TANGENT.name]
    medians = {name: float(np.median(values)) for name, values in times.items()}
    reproduction.claim(
        "(12) takes as long as (4): ratio of the times",
        round(17.87 / 17.49, 2),
        Estimate(float(np.median(ratio)), float(ratio.min()), float(ratio.max())),
        holds(float(np.median(ratio)) <= _EQUAL_TIME),
        f"17.49 and 17.87 µs there; batches of {_TIMED}, {_ROUNDS} rounds in turn, their range as the interval: (4) "
        f"{medians[TANGENT.name]:.2f}, (8) {medians[LINES.name]:.2f}, (12) {medians[RAYS.name]:.2f} µs; equal is read "
        f"as a ratio up to {_EQUAL_TIME}",
    )


def _tabulate(reproduction: Reproduction, errors: dict[str, Array], times: dict[str, Array]) -> None:
    rows = []
    for method in METHODS + YARDSTICKS:
        found = errors[method.name]
        cost = f"{np.median(times[method.name]):.2f}" if method.name in times else "–"
        shares = [f"{share.value:.3f}" for share in _row(found)]
        rows.append([method.name, *shares, f"{np.median(found):.3f}", cost])
        if method.paper is not None:
            rows.append([f"{method.name}, paper", *(f"{value:.3f}" for value in method.paper), "–", "–"])
    headings = ["method", *(f"≤ {limit:.0%}" for limit in LIMITS), "median error, sides", "µs per fix"]
    reproduction.table("Three stations, bearings ±45°: share of trials by error over side", headings, rows)


def _tabulate_lengths(reproduction: Reproduction, errors: dict[str, Array]) -> None:
    """Table 1 under other reference lengths: none but the side comes near."""
    rows = []
    for name, length in (("side", 1.0), ("diagonal", math.sqrt(2.0)), ("mean distance of two points", _MEAN_DISTANCE)):
        for method in (LINES, RAYS):
            assert method.paper is not None
            shares = [share.value for share in _row(errors[method.name] / length)]
            worst = max(abs(share - value) for share, value in zip(shares, method.paper, strict=True))
            rows.append([name, method.name, *(f"{share:.3f}" for share in shares), f"{worst:.3f}"])
    headings = ["length", "method", *(f"≤ {limit:.0%}" for limit in LIMITS), "farthest from the paper"]
    reproduction.table("What the error is relative to", headings, rows)


def _draw_curves(reproduction: Reproduction, errors: dict[str, Array]) -> None:
    caption = "Figure 4: how often the error stays below a share of the side; circles are the paper's Table 1."
    with reproduction.figure("error_probability", caption, size=(6.4, 4.4)) as axes:
        limits = np.linspace(0.0, 1.0, 201)
        for method in METHODS + YARDSTICKS:
            found = np.sort(errors[method.name])
            share = np.searchsorted(found, limits, side="right") / len(found)
            axes.plot(limits, share, method.style, color=method.colour, lw=1.8, label=method.name)
            if method.paper is not None:
                axes.plot(LIMITS, method.paper, "o", color=method.colour, mfc="white", ms=6, zorder=3)
        axes.plot([], [], "o", color="black", mfc="white", ms=6, label="paper, Table 1")
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.01), xlabel="error / side of the square", ylabel="share of trials")
        axes.grid(alpha=0.3)
        axes.legend(loc="lower right", fontsize=8, framealpha=0.95)


_FALSE_FIX = Trials(
    stations=np.array([[[0.64], [0.59], [0.28]], [[0.58], [0.71], [0.57]]]),
    bearings=np.radians([[-83.0], [-79.0], [114.0]]),
    target=np.array([[0.38], [0.60]]),
)
"""Two bearings nearly parallel: lines meet behind the third station, which is where the likelihood is largest."""


def _draw_false_fix(reproduction: Reproduction) -> None:
    scene = _FALSE_FIX
    caption = "Figure 2: lines reach backwards (dotted), so that they meet behind a station; rays do not."
    with reproduction.figure("false_fix", caption, size=(6.4, 4.2)) as axes:
        u = direction(scene.bearings)
        for index, (place, ray) in enumerate(zip(scene.stations[..., 0].T, u[..., 0].T, strict=True)):
            ahead, behind = (np.column_stack([place, place + reach * ray]) for reach in (2.0, -2.0))
            axes.plot(*ahead, color="black", lw=1.0, label="bearing" if index == 0 else None)
            axes.plot(*behind, color="black", lw=0.9, ls=":", label="its other side" if index == 0 else None)
        axes.plot(*scene.stations[..., 0], "^", color="black", ms=8, label="station")
        axes.plot(*scene.target, "*", color=PURPLE, ms=14, label="target")
        for method, marker in zip(METHODS, "svoD", strict=True):
            fix = method.locate(scene.stations, scene.bearings)
            axes.plot(*fix, marker, color=method.colour, mfc="none", mew=2, ms=11, ls="none", label=method.name)
        axes.set(xlim=(-0.2, 0.9), ylim=(0.25, 0.95), xlabel="east, sides", ylabel="north, sides")
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
        axes.legend(loc="lower left", fontsize=8, framealpha=0.95)
