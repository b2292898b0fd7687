"""``passloc soak``: legs that can be flown again, a page that says what was found, and an exit status that tells."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from passloc_env import SCENARIOS
from passloc_env.metrics import lost
from training.reliability import command
from training.reliability.flight import Tally, indefinite
from training.reliability.leg import Leg, draw
from training.reliability.page import page
from training.reliability.record import LONG, MOST_GROWTH, Record
from training.reliability.survival import FAULTS, TRACKED, cases

Said = tuple[int, str, str]
Passloc = Callable[..., Said]


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the legs flown; each pretends to make 1000 steps."""
    numbers: list[int] = []

    def pretend(leg: Leg, steps: int, tell: Callable[[str], None]) -> Tally:
        numbers.append(leg.number)
        return Tally(legs=1, steps=1000)

    monkeypatch.setattr(command, "fly_leg", pretend)
    return numbers


@pytest.fixture
def breaking(monkeypatch: pytest.MonkeyPatch) -> None:
    """The third leg breaks."""

    def pretend(leg: Leg, steps: int, tell: Callable[[str], None]) -> Tally:
        if leg.number == 2:
            tell("ZeroDivisionError: as wanted")
        return Tally(legs=1, steps=1000, exceptions=int(leg.number == 2))

    monkeypatch.setattr(command, "fly_leg", pretend)


def test_it_flies_until_the_steps_are_made_and_writes_the_page(
    flown: list[int], passloc: Passloc, tmp_path: Path
) -> None:
    out = tmp_path / "new" / "reliability.md"
    status, said, _ = passloc(
        "soak", "--steps", "4500", "--episodes", "2", "--out", str(out), "--json", str(out) + ".json"
    )
    assert status == 0
    assert flown == list(range(5))
    assert said.startswith("seed 0\n")
    text = out.read_text(encoding="utf-8")
    assert text.startswith("# Reliability\n")
    assert "| **all** | 5 | 5,000 | 0 | 0 | 0 | 0 | 0 |" in text
    assert f"passloc soak --steps 4500 --episodes 2 --seed 0 --out {out.as_posix()}" in text
    rows = [line for line in text.splitlines() if line.startswith(tuple(f"| {faults} |" for faults in FAULTS))]
    assert len(rows) == len(list(cases()))
    assert all(f"### {each.title}\n" in text for each in TRACKED)
    data = json.loads(Path(f"{out}.json").read_text(encoding="utf-8"))
    assert sum(tally["steps"] for tally in data["scenarios"].values()) == 5000
    assert len(data["survivals"]) == len(rows)


def test_one_leg_alone_writes_nothing(flown: list[int], passloc: Passloc, tmp_path: Path) -> None:
    out = tmp_path / "reliability.md"
    assert passloc("soak", "--leg", "17", "--seed", "3", "--out", str(out))[0] == 0
    assert flown == [17]
    assert not out.exists()


@pytest.mark.usefixtures("breaking")
def test_what_breaks_is_told_with_the_leg_that_repeats_it(passloc: Passloc, tmp_path: Path) -> None:
    out = tmp_path / "reliability.md"
    status, said, error = passloc("soak", "--steps", "3000", "--episodes", "2", "--seed", "5", "--out", str(out))
    assert status == 1
    line = f"seed 5, leg 2 ({list(SCENARIOS)[2]}, {type(draw(5, 2).scenario.tracker).__name__})"
    for text in (said, error, out.read_text(encoding="utf-8")):
        assert f"{line}: ZeroDivisionError: as wanted" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--steps", "0"), "steps = 0 is not possible: must be at least 1"),
        (("--episodes", "0"), "episodes = 0 is not possible: must be at least 1"),
        (("--seed", "-1"), "seed = -1 is not possible: must be at least 0"),
        (("--leg", "-2"), "leg = -2 is not possible: must be at least 0"),
    ],
)
def test_impossible_numbers_are_refused(words: tuple[str, str], message: str, passloc: Passloc) -> None:
    assert passloc("soak", *words)[::2] == (2, f"passloc: {message}\n")


def test_legs_are_of_every_kind() -> None:
    """Over 300 legs: every scenario and tracker, gates, faults, both modes, small batches and large, and all valid."""
    legs = [draw(1, number) for number in range(300)]
    assert {leg.scenario.name for leg in legs} == set(SCENARIOS)
    assert len({type(leg.scenario.tracker).__name__ for leg in legs}) == 8
    assert {getattr(leg.scenario.tracker, "gate", None) for leg in legs} == {None, 0.0, 0.9, 0.99, 0.999}
    gating = {type(leg.scenario.tracker).__name__ for leg in legs if getattr(leg.scenario.tracker, "gate", 0.0)}
    assert {"InteractingModels", "FilterPyTracker"} < gating
    assert {leg.mode for leg in legs} == {"NextStep", "SameStep"}
    assert 0.3 < np.mean([leg.scenario.sensors[0].faults.outlying for leg in legs]) < 0.7
    sizes = [leg.environments for leg in legs]
    assert min(sizes) == 1
    assert max(sizes) > 1000
    assert all(leg.scenario != SCENARIOS[leg.scenario.name] for leg in legs)


def test_every_sensor_fails_and_every_tracker_gates() -> None:
    """Faults and gates get into the scenarios flown, and every case is another one."""
    scenarios = [case.scenario for case in cases()]
    assert len(set(map(str, scenarios))) * len({case.policy for case in cases()}) == len(scenarios)
    for case, scenario in zip(cases(), scenarios, strict=True):
        assert getattr(scenario.tracker, "gate", None) == case.gate
        assert all((sensor.detection_probability < 1.0) == (case.faults != "none") for sensor in scenario.sensors)
        assert all(sensor.faults.outlying == ("outliers" in case.faults) for sensor in scenario.sensors)


def test_the_growth_is_the_slope_of_the_second_half() -> None:
    """Of memory that grows by 3 MiB per million steps after a first half that grew by much more."""
    record = Record(0, "passloc soak")
    assert math.isnan(record.growth)
    steps = np.arange(1, 41) * 250_000
    record.memory = [(int(s), 500.0 + 3e-6 * s + (100.0 if s > 2e6 else 0.0)) for s in steps]
    assert record.growth == pytest.approx(3.0, rel=1e-9)
    assert record.broken() == []
    record.memory = [(s, (MOST_GROWTH + 1.0) / 3.0 * m) for s, m in record.memory]
    assert record.broken() == [f"memory grows by 5.0 MiB per million steps, {MOST_GROWTH:g} are allowed"]
    assert "What broke:\n\n- memory grows" in page(record, 1)
    record.memory = record.memory[: LONG // 250_000 - 1]
    assert record.broken() == []
    assert "memory is not measured.**" in page(record, 1)


def test_too_many_repairs_break_the_promise() -> None:
    record = Record(0, "passloc soak")
    record.add("BearingsOnly", Tally(legs=1, steps=100_000, repairs=9))
    assert record.broken() == []
    record.add("BearingsOnly", Tally(legs=1, repairs=2))
    assert record.broken() == ["1.1e-04 repairs per step, below 0.0001 are allowed"]


def test_indefinite_covariances_are_told_by_their_eigenvalues() -> None:
    scale = np.array([1e6, 1e-6])
    good, bad = np.array([[1.0, 0.999], [0.999, 1.0]]), np.array([[1.0, 1.001], [1.001, 1.0]])
    negative, broken = np.diag([1.0, -1.0]), np.diag([1.0, np.nan])
    covariance = np.stack([np.outer(scale, scale) * each for each in (good, bad, negative, broken)], axis=-1)
    assert indefinite(covariance).tolist() == [False, True, True, True]


@pytest.mark.parametrize("place", [(0, 2), (2, 0)])
def test_covariances_that_are_not_symmetric_to_the_last_bit_are_told(place: tuple[int, int]) -> None:
    covariance = np.repeat(np.full((3, 3), 0.5) + np.eye(3), 2).reshape(3, 3, 2)
    covariance[(*place, 1)] = np.nextafter(0.5, 1.0)
    assert indefinite(covariance).tolist() == [False, True]


def test_lost_tracks_are_those_of_the_metrics() -> None:
    """The page says what counts as lost; so does the function."""
    assert lost(np.array([0.5, 1.5, 0.5, np.nan]), np.array([9.0, 9.0, 101.0, 9.0])).tolist() == [
        False,
        True,
        True,
        True,
    ]
