"""Figures of the papers that must explain themselves: labels, marks and ticks of what is drawn from made-up errors."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from training.papers import bearing_doppler, dual_array, dual_satellite, radial_acceleration
from training.papers.monte_carlo import History
from training.papers.reproduction import Reproduction
from training.papers.satellite_record import Errors

RUNS = 3


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Figure]]:
    """Every figure that is drawn, kept open for inspection."""
    kept: list[Figure] = []
    with monkeypatch.context() as patch:
        patch.setattr(plt, "close", kept.append)
        yield kept
    plt.close("all")


def errors(level: float) -> Errors:
    """Errors that fall from some kilometres to a level in metres, in all runs alike."""
    time = np.arange(1.0, 101.0)
    values = np.repeat(level * (1.0 + 20.0 / time)[:, None], RUNS, axis=1)
    return Errors(time, values, values / 100.0, values / 1e5, values)


def history(end: float) -> History:
    """A history of the same kind."""
    time = np.linspace(2.0, end, 50)
    flat = np.full((50, RUNS), 100.0)
    extra = dict.fromkeys(("velocity", "velocity bound"), flat)
    return History(time, flat, 0.5 * flat, 10.0 * flat, flat, 6, extra)


def ticks(axes: Axes) -> list[str]:
    """The labels of the ticks on a height that can be seen."""
    axes.figure.canvas.draw()
    low, high = axes.get_ylim()
    return [label.get_text() for label in axes.get_yticklabels() if low <= label.get_position()[1] <= high]


def names(figure: Figure) -> list[str]:
    """What the legends of a figure name."""
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return [text.get_text() for legend in legends if legend is not None for text in legend.get_texts()]


def test_beats_that_lose_nothing_share_one_line_of_the_legend(tmp_path: Path, figures: list[Figure]) -> None:
    found = {"per pulse": errors(200.0)}
    for label, loss in (("0.1 s", 1.9), ("1 s", 2.1)):
        found[f"{label} beats, start value"] = errors(200.0 * loss)
        found |= {f"{label} beats, {cut}": errors(200.0) for cut in ("mid-beat value", "value + rate")}
    dual_satellite._draw_processing(Reproduction("dual-satellite", tmp_path), found)
    assert names(figures[0]) == [
        "per pulse",
        "0.1 s beats, start value",
        "mid-beat value or value + rate of either beat",
        "1 s beats, start value",
    ]
    # All seven are drawn, and the empty one that the legend takes its line from.
    assert len(figures[0].axes[0].lines) == 8
    assert {"0.5", "1", "2", "5"} <= set(ticks(figures[0].axes[0]))


def test_sets_of_measurements_have_readable_ticks(tmp_path: Path, figures: list[Figure]) -> None:
    found = {kind: errors(200.0) for kind in dual_satellite._SETS}
    dual_satellite._draw_sets(Reproduction("dual-satellite", tmp_path), found, "pulse", "per pulse", (3, 4, 5))
    for axes in figures[0].axes:
        shown = ticks(axes)
        assert len(shown) >= 3
        assert {f"{float(text):g}" for text in shown} == set(shown)


def test_every_bound_names_its_track_and_both_passages_are_marked(tmp_path: Path, figures: list[Figure]) -> None:
    tracks = (dual_array.PLAIN, dual_array.AWARE, dual_array.NEAR, dual_array.FAR)
    dual_array._draw(Reproduction("dual-array", tmp_path), {track: history(1000.0) for track in tracks})
    named = names(figures[0])
    assert len(set(named)) == len(named) == 7
    assert [name for name in named if name.startswith("bound")] == [
        "bound on the baseline",
        "bound 50 m off the baseline",
        "bound 1000 m off the baseline",
    ]
    for axes in figures[0].axes:
        assert [text.get_text().strip() for text in axes.texts] == ["array 1", "array 2"]
        assert [text.get_position()[0] for text in axes.texts] == [500.0, dual_array._SECOND]


def test_the_second_passage_is_where_the_emitter_is_a_kilometre_on() -> None:
    """20 m/s at array 1, slowing by 0.04 m/s²."""
    after = dual_array._SECOND - 500.0
    assert 20.0 * after - 0.02 * after**2 == pytest.approx(1000.0, abs=1.0)  # a tenth of a second is printed


def test_tracks_of_the_cases_have_a_legend(tmp_path: Path, figures: list[Figure]) -> None:
    cases = {case: history(300.0) for case in bearing_doppler.CASES}
    bearing_doppler._draw(Reproduction("bearing-doppler", tmp_path), cases)
    assert names(figures[-1]) == ["emitter", "its start", "station"]


def test_ends_of_the_radial_tracks_name_their_speeds(tmp_path: Path, figures: list[Figure]) -> None:
    radial_acceleration._draw_scene(Reproduction("radial-acceleration", tmp_path))
    (axes,) = figures[0].axes
    marked = {(text.get_text(), *np.round(text.xy, 6)) for text in axes.texts}  # type: ignore[attr-defined]
    expected = {
        (f"{speed:g} m/s", *np.round([-reach * np.sin(angle), 200.0 - reach * np.cos(angle)], 6))
        for speed in (200.0, 350.0)
        for angle in np.radians([0.0, 45.0, 60.0])
        for reach in [0.3 * speed]
    }
    assert marked == expected
