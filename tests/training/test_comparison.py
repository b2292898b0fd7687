"""The table of fixed against moving observers: every figure is that of the runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import find_policy
from passloc_env.scenarios import SCENARIOS
from training.papers.comparison import HEADINGS, MOVING, fixed_against_moving, row
from training.papers.monte_carlo import History, run
from training.papers.reproduction import Reproduction

QUICK = SCENARIOS["BearingDopplerCase1b"].override({"episode.steps": 40})


def test_a_row_by_hand() -> None:
    """Two runs that end 10 % and 0.1 % off, one of them lost by its NEES; the closest approach is that of any run."""
    history = History(
        time=np.array([1.0, 2.0]),
        error=np.array([[900.0, 900.0], [100.0, 1.0]]),
        bound=np.array([[900.0, 900.0], [50.0, 50.0]]),
        range=np.array([[800.0, 2000.0], [1000.0, 1000.0]]),
        nees=np.array([[1.0, 1.0], [396.0, 4.0]]),
        states=4,
    )
    name, error, interval, bound, ratio, consistency, lost, closest = row("somebody", history)
    assert (name, error, bound, ratio, lost, closest) == ("somebody", "7.07", "5", "1.41", "50", "0.8")
    assert interval == "0.1–10"  # resamples of two hold either run twice
    assert consistency.startswith("50.00 [0.2")
    assert len(HEADINGS) == 8


def test_the_table_holds_the_fixed_station_and_every_rule(tmp_path: Path) -> None:
    reproduction = Reproduction("bearing-doppler", tmp_path, seed=11)
    histories = fixed_against_moving(reproduction, "A blind case", QUICK, 6)
    (table,) = reproduction.tables
    assert (table.title, table.headings) == ("A blind case", HEADINGS)
    assert list(histories) == ["stationary", *MOVING]
    assert [line[0] for line in table.rows] == [find_policy(rule, QUICK).name for rule in histories]
    for (rule, history), line in zip(histories.items(), table.rows, strict=True):
        assert history.error.shape == (40, 6)
        np.testing.assert_array_equal(history.error, run(QUICK, 6, 11, rule).error)
        assert line == row(find_policy(rule, QUICK).name, history)
    assert not reproduction.claims


@pytest.mark.parametrize("rules", [(), ("fly-at",), ("circle", "zigzag:angle=30:leg=8")])
def test_rules_may_be_chosen(tmp_path: Path, rules: tuple[str, ...]) -> None:
    reproduction = Reproduction("bearing-doppler", tmp_path)
    histories = fixed_against_moving(reproduction, "Some rules", QUICK.override({"episode.steps": 8}), 2, rules)
    assert list(histories) == ["stationary", *rules]
    assert len(reproduction.tables[0].rows) == 1 + len(rules)
