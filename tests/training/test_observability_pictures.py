"""Pictures of surveys: who is who, in which unit, and nothing of the episode beyond the edge unsaid."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from agents import find_policy
from passloc_env.scenarios import SCENARIOS
from passloc_env.survey import Survey
from training import observability_pictures

Drawn = Callable[..., tuple[Survey, Figure]]


@pytest.fixture
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drawn:
    """Draws a scenario flown by a rule, on a coarse map: the survey and the figure."""
    figures: list[Figure] = []
    monkeypatch.setattr(observability_pictures, "_CELLS", 9)
    monkeypatch.setattr(plt, "close", figures.append)

    def draw(name: str, rule: str = "stationary", **changes: Any) -> tuple[Survey, Figure]:
        overrides = {key.replace("__", "."): value for key, value in changes.items()}
        scenario = SCENARIOS[name].override({"episode.steps": 20, **overrides})
        policy = find_policy(rule, scenario)
        survey = Survey(scenario.override(dict(policy.overrides)), policy.act, 3)
        observability_pictures.draw_survey(survey, name, tmp_path / "map.png")
        return survey, figures[-1]

    return draw


def legend(figure: Figure, panel: int) -> list[str]:
    """What is named under a panel."""
    return [text.get_text() for text in figure.axes[panel].get_legend().get_texts()]


@pytest.mark.parametrize(("name", "rule"), [("CrossFix", "circle"), ("DualSatellite", "yaw")])
def test_several_platforms_are_told_apart(drawn: Drawn, name: str, rule: str) -> None:
    """Numbered, in colours of their own, and the range is that of a certain one."""
    survey, figure = drawn(name, rule)
    numbers = range(len(survey.scenario.platforms))
    names = [f"platform {number}" for number in numbers]
    assert legend(figure, 0)[: len(names)] == names
    assert [text.get_text() for text in figure.axes[0].texts] == [str(number) for number in numbers]
    colours = {line.get_label(): line.get_color() for line in figure.axes[0].lines}
    assert len({colours[name] for name in names}) == len(names)
    assert "range of platform 0" in legend(figure, 1)


def test_one_observer_needs_no_number(drawn: Drawn) -> None:
    _, figure = drawn("BearingsOnly", "circle")
    assert legend(figure, 0) == ["observer", "emitter of this episode", "minimum range at the end"]
    assert legend(figure, 1) == ["bound on the position", "range"]
    assert figure.axes[1].get_ylabel() == "range and bound on the position, m"
    assert not figure.axes[0].texts


def test_the_keep_out_is_drawn_where_the_emitter_ends(drawn: Drawn) -> None:
    survey, figure = drawn("BearingsOnly", "circle")
    (circle,) = figure.axes[0].patches
    assert circle.get_radius() == pytest.approx(10.0)  # type: ignore[attr-defined]
    np.testing.assert_allclose(circle.get_center(), survey.states[-1, :2] / 1e3)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["BearingsOnly", "CrossFix", "DualArray", "RadialAcceleration"])
def test_the_map_holds_everything_that_moves(drawn: Drawn, name: str) -> None:
    """Also an emitter that runs away."""
    survey, figure = drawn(name, "straight", episode__steps=200, episode__decision_every=10)
    axes = figure.axes[0]
    platforms = [pose.position[:2, 0] for poses in survey.path for pose in poses]
    for east, north in (*platforms, *survey.states[:, :2]):
        assert axes.get_xlim()[0] < east / 1e3 < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < north / 1e3 < axes.get_ylim()[1]


def test_lever_arms_are_drawn(drawn: Drawn) -> None:
    """A kilometre from the vessel, along its heading, at start and end; also when its length is drawn by lot."""
    _, figure = drawn("DualArray", "circle", sensors__1__lever_arm=[{"type": "Uniform", "low": 900, "high": 1100}, 0])
    arms = [line for line in figure.axes[0].lines if line.get_marker() == "s"]
    lengths = [float(np.hypot(*np.diff(line.get_xydata(), axis=0)[0])) for line in arms]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)
    assert 0.9 < lengths[0] < 1.1
    assert legend(figure, 0).count("lever arm at start and end") == 1


def test_colour_bars_are_plain_kilometres(drawn: Drawn) -> None:
    _, figure = drawn("BearingsOnly", "circle")
    bar = figure.axes[2]
    assert bar.get_ylabel() == "bound on the position at the end, km"
    figure.canvas.draw()
    shown = [text.get_text() for text in bar.get_yticklabels()]
    assert len(shown) >= 2
    for text, height in zip(shown, bar.get_yticks(), strict=True):
        assert float(text) == pytest.approx(height)
        assert "10^" not in text


def test_what_is_never_heard_is_said_to_be_constant_and_far(drawn: Drawn) -> None:
    """The satellites are on the other side of the Earth, and off the map."""
    _, figure = drawn("DualSatellite", target__start__longitude=3.0, episode__steps=10)
    assert figure.axes[2].get_ylabel().endswith("nearly constant")
    assert legend(figure, 0)[:2] == ["platform 0 (outside the map)", "platform 1 (outside the map)"]
