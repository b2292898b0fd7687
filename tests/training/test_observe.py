"""``passloc observe``: what it prints, draws and writes, and what it refuses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from agents import find_policy
from passloc_env.layout import StateLayout
from passloc_env.nuisance import Nuisance
from passloc_env.scenarios import SCENARIOS
from passloc_env.survey import Survey
from training.commands import EVALUATION_SEED
from training.observe import _direction

Said = tuple[int, str, str]
Passloc = Callable[..., Said]
QUICK = ("--override", "episode.steps=20")


def assert_drawn(path: Path) -> None:
    """A picture that is worth looking at: wide enough, and of many colours."""
    picture = matplotlib.image.imread(path)[..., :3]
    assert picture.shape[1] > 1000
    assert picture.shape[0] > 400
    assert len(np.unique(picture @ np.array([1.0, 300.0, 9e4]))) > 100


def assert_weakest(out: str, survey: Survey) -> None:
    """The printed direction is the survey's, in prior deviations, largest part first, nothing of weight left out."""
    report, states = survey.rank(), survey.layout.names
    found = re.search(r"weakest direction, one prior deviation \(σ\) along it: (.*)$", out, re.MULTILINE)
    assert found
    assert found[1].startswith(f"{report.weakest_name[0]} +")
    printed = re.findall(r"([a-z_0-9 ]+) ([+-][0-9.]+)σ \(\S+ (?:m|m/s|m/s²|Hz|rad)\)(?:, |$)", found[1])
    shares = {name: float(share) for name, share in printed}
    deviations = report.weakest[:, 0] / np.sqrt(np.diagonal(survey.prior[..., 0]))
    for row, state in enumerate(states):
        # Two decimals are printed, of parts from a twentieth of the largest on.
        assert deviations[row] == pytest.approx(shares.get(state, 0.0), abs=0.006 if state in shares else 0.05)


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("BearingsOnly", "circle"),
        ("BearingDopplerCase1b", "stationary"),
        ("DualArray", "zigzag:angle=30"),
        ("CrossFix", "perpendicular"),
        ("DualSatellite", "yaw"),
    ],
)
def test_it_prints_draws_and_writes_a_survey(passloc: Passloc, tmp_path: Path, name: str, rule: str) -> None:
    """One vehicle, several, a lever arm, satellites: all the numbers are those of the survey."""
    words = ("observe", name, "--policy", rule, "--seed", "3", "--out", "map.png", "--json", "results.json")
    status, out, err = passloc(*words, *QUICK)
    assert (status, err) == (0, "")
    scenario = SCENARIOS[name].override({"episode.steps": 20})
    policy = find_policy(rule, scenario)
    survey = Survey(scenario.override(dict(policy.overrides)), policy.act, 3)
    report = survey.rank()

    assert f"{name}, flown by {policy.name}, seed 3" in out
    assert f"20 measurements determine {report.rank[0]} of {survey.layout.size} states" in out
    assert_weakest(out, survey)
    assert "map of the bound over emitter positions: map.png" in out
    first, last = (f"{survey.position_bound[k]:.4g}" for k in (0, -1))
    rows = [line for line in out.splitlines() if line.count("│") == 5]
    assert first in rows[0]
    assert last in rows[-1]
    assert_drawn(tmp_path / "map.png")

    data = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert (data["scenario"], data["policy"], data["states"]) == (name, policy.name, list(survey.layout.names))
    assert data["rank"] == report.rank[0]
    for key, values in (("time", survey.time), ("range", survey.range), ("position_bound", survey.position_bound)):
        np.testing.assert_array_equal(data[key], values)
    np.testing.assert_array_equal(data["gramian"], survey.gramian)
    np.testing.assert_array_equal(data["weakest_direction"], report.weakest[:, 0])
    condition = float(report.condition[0])
    assert data["condition"] == (condition if condition < 1e12 else None)


def test_the_fixed_station_of_case_1b_is_blind_to_the_range(passloc: Passloc) -> None:
    """Emitter and range scatter together: two parts east to one part north, and no velocity in it."""
    status, out, _ = passloc("observe", "BearingDopplerCase1b")
    assert status == 0
    assert f"seed {EVALUATION_SEED}" in out
    assert "300 measurements determine 3 of 4 states; condition unbounded" in out
    found = re.search(r"along it: east \+0.71σ \((\S+) m\), north \+0.71σ \((\S+) m\)$", out, re.MULTILINE)
    assert found
    assert float(found[1]) == pytest.approx(2.0 * float(found[2]), rel=0.02)  # three digits are printed
    assert Path(f"runs/observe/BearingDopplerCase1b-stationary-{EVALUATION_SEED}.png").stat().st_size > 10_000


def test_the_same_seed_draws_the_same(passloc: Passloc, tmp_path: Path) -> None:
    for seed, name in (("1", "one"), ("1", "again"), ("2", "two")):
        words = ("--seed", seed, "--out", f"{name}.png", "--json", f"{name}.json", "--override", "episode.steps=4")
        assert passloc("observe", "BearingsOnly", "--policy", "random", *words)[0] == 0
    for ending in ("json", "png"):
        one, again, two = ((tmp_path / f"{name}.{ending}").read_bytes() for name in ("one", "again", "two"))
        assert one == again != two


def test_pictures_without_a_name_are_named_by_scenario_policy_and_seed(passloc: Passloc) -> None:
    """No seed draws over another one's picture."""
    for seed in ("3", "4"):
        status, out, _ = passloc("observe", "BearingsOnly", "--policy", "zigzag:angle=45", "--seed", seed, *QUICK)
        assert status == 0
        (picture,) = Path("runs/observe").glob(f"*-{seed}.png")
        assert str(picture) in out
        assert re.fullmatch(r"BearingsOnly-zigzag[\w.=-]*\.png", picture.name)


def test_scenarios_from_files(passloc: Passloc, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("name: Mine\nepisode: {steps: 8}\n", encoding="utf-8")
    status, out, _ = passloc("observe", "mine.yaml", "--out", "mine.png")
    assert status == 0
    assert "Mine, flown by stationary" in out
    assert "8 measurements determine" in out


def test_an_emitter_below_the_horizon_is_not_observed(passloc: Passloc, tmp_path: Path) -> None:
    """It is drawn and said, not crashed on: no state is determined, and the bound only grows."""
    words = ("--out", "hidden.png", "--json", "hidden.json", "--override", "episode.steps=10")
    status, out, err = passloc("observe", "DualSatellite", *words, "target.start.longitude=3.0")
    assert (status, err) == (0, "")
    data = json.loads((tmp_path / "hidden.json").read_text(encoding="utf-8"))
    assert np.diff(data["position_bound"]).min() > 0.0
    assert (data["rank"], data["heard"]) == (0, 0)
    assert "0 of 10 looks heard; the bound is the prior's" in out
    assert "determine 0 of 12 states" in out
    assert "weakest direction" not in out


def test_looks_that_were_missed_are_counted(passloc: Passloc, tmp_path: Path) -> None:
    words = ("--json", "some.json", "--override", "episode.steps=40", "sensors.0.detection_probability=0.5")
    status, out, _ = passloc("observe", "BearingsOnly", *words)
    assert status == 0
    heard = json.loads((tmp_path / "some.json").read_text(encoding="utf-8"))["heard"]
    assert 0 < heard < 40
    assert f"{heard} of 40 looks heard\n" in out


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("BearingOnly",), "did you mean 'BearingsOnly'?"),
        (("nowhere.yaml",), "cannot be read"),
        (("BearingsOnly", "--policy", "cirle"), "did you mean 'circle'?"),
        (("BearingsOnly", "--policy", "zigzag:leg=x"), "name=number"),
        (("BearingsOnly", "--policy", "nowhere/agent.json"), "cannot read"),
        (("BearingsOnly", "--override", "episode.stepz=8"), "did you mean 'steps'?"),
        (("BearingsOnly", "--override", "episode.steps=0"), "at least 1"),
        (("BearingsOnly", "--policy", "yaw"), "no platform of BearingsOnly turns its body"),
        (("BearingsOnly", "--out", "/dev/null/map.png"), "/dev/null is not a folder"),
        (("BearingsOnly", "--out", "."), "is a folder"),
        (("BearingsOnly", "--json", "/dev/null/results.json"), "/dev/null is not a folder"),
        (("BearingsOnly", "--json", "."), "is a folder"),
        (("BearingsOnly", "--seed", "-1"), "seed = -1 is not possible"),
        (("BearingsOnly", "--out", "map.xyz"), "map.xyz"),
    ],
)
def test_refusals_are_one_line(refused: Callable[..., str], words: tuple[str, ...], hint: str) -> None:
    """And come before anything is flown or written."""
    assert hint in refused("observe", *words)
    assert not [path for path in Path().rglob("*") if path.is_file()]


def test_the_picture_is_where_it_is_said_to_be(passloc: Passloc) -> None:
    """Also when its name has no ending: refused, or drawn there."""
    status, out, _ = passloc("observe", "BearingsOnly", "--out", "map", *QUICK)
    if status == 0:
        said = out.split("emitter positions: ")[1].strip()
        assert Path(said).is_file()
    assert status in (0, 2)


def test_directions_name_what_matters_with_units() -> None:
    """By the share in prior deviations: hundreds of metres may be nothing, a thousandth of a radian everything."""
    layout = StateLayout(2, 2, ("carrier_offset", "roll_error_0", "mine"))
    nuisances = [Nuisance(name, 1.0, unit=unit) for name, unit in zip(layout.nuisance, ("Hz", "rad", ""), strict=True)]
    scale = np.array([1e4, 1e4, 10.0, 10.0, 0.1, 0.1, 500.0, 1e-3, 2.0])
    shares = np.array([0.04, -0.06, 0.0, 0.1, 0.0, 0.03, -0.5, 0.8, 0.2])
    assert _direction(scale * shares, scale, layout, nuisances) == (
        "roll_error_0 +0.80σ (0.0008 rad), carrier_offset -0.50σ (-250 Hz), mine +0.20σ (0.4), "
        "north velocity +0.10σ (1 m/s), north -0.06σ (-600 m)"
    )
