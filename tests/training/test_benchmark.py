"""The benchmark's machinery with tiny settings: structure and counting, never speed."""

import dataclasses
import io
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from passloc_env import SCENARIOS, Scenario
from passloc_env.errors import InputError
from training import benchmark
from training.answer import plain
from training.benchmark import Bench, harness, limit, report
from training.benchmark.floors import FLOORS, shortfalls
from training.benchmark.growth import VARIANTS, measure_growth
from training.benchmark.page import exponent, write_page
from training.benchmark.peers import TOGETHER, measure_peers
from training.benchmark.report import Results, Row, Spread, Stepping, spread
from training.cli import main
from training.commands import Output
from training.files import json_text

BEARING_DOPPLER = SCENARIOS["BearingDoppler"]
ALONE = {"states": False, "workers": 1, "peers": False, "growth": False, "trackers": False, "learning": False}
"""Nothing but the main table."""
TINY = Bench(sizes=(1, 3), rounds=2, seconds=0.001, **ALONE)


@pytest.fixture(scope="module")
def results() -> Results:
    return benchmark.measure(TINY)


def test_docstring_names_the_project() -> None:
    assert benchmark.__doc__ is not None
    assert "passloc" in benchmark.__doc__.splitlines()[0]


def test_every_candidate_has_its_row(results: Results) -> None:
    rows = [(row.name, row.environments) for row in results.stepping.rows]
    assert rows == [
        ("FilterPy environment", 1),
        ("Stone Soup filter", 1),
        ("passloc, scalar", 1),
        ("passloc, vector", 1),
        ("passloc, vector", 3),
        ("passloc, vector + network", 3),
        *[("C kernel, the limit", 3)] * (limit.library() is not None),
    ]
    assert results.learning == ()
    for row in results.stepping.rows:
        for measured in (row.per_cpu_second, row.per_wall_second, row.cpu_ratio, row.wall_ratio):
            assert 0.0 < measured.low <= measured.median <= measured.high
        assert ("tracker only" in row.note) == (row.name == "Stone Soup filter")


def test_the_peer_is_compared_with_itself(results: Results) -> None:
    peer = results.stepping.rows[0]
    assert peer.cpu_ratio == peer.wall_ratio == Spread(1.0, 1.0, 1.0)


def test_json_holds_everything(results: Results) -> None:
    data = json.loads(json_text(plain(results)))
    tables = {"stepping", "states", "workers", "peers", "growth", "trackers", "learning"}
    assert set(data) == {"command", "date", "machine"} | tables
    assert data["stepping"]["rows"][0]["cpu_ratio"] == {"median": 1.0, "low": 1.0, "high": 1.0}
    assert {"numpy", "filterpy", "gymnasium"} <= set(data["machine"]["versions"])
    assert data["machine"]["cores"] >= 1
    assert data["date"] is None


def test_the_table_fits_a_terminal(results: Results) -> None:
    wide = Spread(0.4567, 0.4321, 0.4789)
    rows = [dataclasses.replace(row, environments=4096, cpu_ratio=wide) for row in results.stepping.rows]
    console = Console(file=io.StringIO(), width=80)
    report.show(dataclasses.replace(results, stepping=dataclasses.replace(results.stepping, rows=rows)), console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "…" not in text
    assert text.count("0.457 (0.432–0.479)") == len(rows)


def test_run_prints_tables_and_answers_with_every_number(capsys: pytest.CaptureFixture[str]) -> None:
    found = benchmark.run(Bench(sizes=(), rounds=1, seconds=0.001, **ALONE), date="2000-01-01")
    assert json.loads(json_text(plain(found))) == json.loads(json.dumps(dataclasses.asdict(found)))
    assert found.date == "2000-01-01"
    assert "FilterPy environment" in capsys.readouterr().out


def test_what_cannot_be_written_is_told_before_measuring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harness, "measure_stepping", None)
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(NotADirectoryError):
        benchmark.run(Bench(out=tmp_path / "file" / "bench"))


def test_tables_print(results: Results) -> None:
    console = Console(file=io.StringIO(), width=80)
    report.show(results, console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "BearingDoppler" in text
    assert "tracker only" in text
    assert "1 (1–1)" in text


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (Bench(), "passloc bench"),
        (
            TINY,
            "passloc bench --sizes 1 3 --rounds 2 --seconds 0.001 --no-states --workers 1 --no-peers --no-growth "
            "--no-trackers --no-learning",
        ),
        (Bench(output=Output(json=Path("x.json")), guard=True, out=Path("page")), "passloc bench"),
    ],
)
def test_command_repeats_the_measurement(arguments: Bench, command: str) -> None:
    assert benchmark.command(arguments) == command


@pytest.mark.parametrize("wrong", [{"rounds": 0}, {"sizes": (0,)}, {"seconds": 0.0}, {"seconds": float("nan")}])
def test_impossible_arguments_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        benchmark.measure(Bench(**wrong))  # type: ignore[arg-type]


def test_more_states_are_measured_against_a_peer_of_as_many() -> None:
    table = harness.measure_states(VARIANTS["6 states"], (2,), 1, 0.001)
    assert table.scenario == "BearingDoppler, 6 states"
    assert [(row.name, row.environments) for row in table.rows] == [("FilterPy environment", 1), ("passloc, vector", 2)]


def test_workers_are_measured_against_one() -> None:
    """At this size there is one process on both sides: what is tested is who is compared with whom."""
    table = harness.measure_workers(BEARING_DOPPLER, (2, 3), 2, 1, 0.001)
    names = ["passloc, vector"] * 2 + ["passloc, 2 workers"] * 2
    assert [(row.name, row.environments) for row in table.rows] == list(zip(names, (2, 3, 2, 3), strict=True))
    assert [row.wall_ratio.median for row in table.rows[:2]] == [1.0, 1.0]


def test_every_scenario_and_variant_has_its_cost() -> None:
    growth = measure_growth(2, 1, 0.001)
    costs = {cost.name: cost for cost in growth.costs}
    assert set(costs) == {*SCENARIOS, *(f"BearingDoppler, {name}" for name in VARIANTS)}
    base = costs["BearingDoppler"]
    assert (base.states, base.scalars, base.steps) == (4, 2, 240)
    assert costs["BearingDoppler, 6 states"].states == 6
    assert [costs[f"BearingDoppler, {n} sensor{'s' * (n > 1)}"].scalars for n in (1, 3, 4)] == [1, 3, 4]
    # Two errors for each of the 241 looks, and a few hundred numbers beside them.
    assert 8e-3 * 2 * 241 < base.kilobytes < 8e-3 * (2 * 241 + 300)
    assert costs["BearingDoppler, 960 steps"].kilobytes - base.kilobytes == pytest.approx(8e-3 * 2 * 720)
    assert all(0.0 < cost.microseconds.low <= cost.microseconds.high for cost in growth.costs)


def test_the_peer_in_wrappers() -> None:
    table = measure_peers(BEARING_DOPPLER.override({"episode.steps": 8}), 1, 0.001)
    assert [row.name for row in table.rows] == [
        "FilterPy environment",
        "SyncVectorEnv",
        "AsyncVectorEnv",
        "DummyVecEnv",
        "SubprocVecEnv",
    ]
    assert {row.environments for row in table.rows[1:]} == {TOGETHER}


def test_the_limit_is_told_where_there_is_one(results: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    def told() -> list[str]:
        return [note for note in harness._shares(results.stepping.rows) if "C kernel" in note]

    assert told() == []
    monkeypatch.setattr(harness, "_MANY", 1)
    assert len(told()) == 2 * (limit.library() is not None)


def test_stone_soup_may_be_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stonesoup", None)
    for name in [name for name in sys.modules if name.startswith("stonesoup.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "training.benchmark.stone_soup", raising=False)
    stepping = harness.measure_stepping(BEARING_DOPPLER, (), 1, 0.001)
    assert "Stone Soup filter" not in [row.name for row in stepping.rows]
    assert any("Stone Soup is not installed" in note for note in stepping.notes)


def test_other_missing_modules_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ModuleNotFoundError("no such module", name="numpy")

    monkeypatch.setattr(harness, "StoneSoupCandidate", broken)
    with pytest.raises(ModuleNotFoundError):
        harness.measure_stepping(BEARING_DOPPLER, (), 1, 0.001)


def short(**overrides: object) -> Scenario:
    return BEARING_DOPPLER.override({"episode.steps": 12, "episode.early_end": False, **overrides})


def test_only_flown_sensor_steps_count() -> None:
    candidate = harness.VectorCandidate(short(), 5, np.random.default_rng(0))
    candidate.warm_up()
    simulation = candidate.env.batch.tiles[0]
    for _ in range(20):
        before = simulation.step_count.copy()
        flown = candidate.step()
        # A decision adds four; a reset puts the clock back.
        assert flown == 4 * np.count_nonzero(simulation.step_count > before)


def test_the_clocks_of_a_batch_are_spread() -> None:
    candidate = harness.VectorCandidate(short(), 12, np.random.default_rng(0))
    candidate.warm_up()
    ends = []
    for _ in range(8):
        candidate.step()
        ends.append(int(np.count_nonzero(candidate._ended)))
    # An episode takes three decisions and the call that resets it.
    assert sum(ends) == 12 * 2
    assert max(ends) <= 4


def test_a_scalar_candidate_resets() -> None:
    peer = harness._candidates(short(), ())[0][0]
    peer.warm_up()
    assert [peer.step() for _ in range(7)] == [4] * 7


def test_spread_is_median_and_extremes() -> None:
    assert spread([3.0, 1.0, 10.0]) == Spread(3.0, 1.0, 10.0)


@pytest.mark.parametrize(
    ("value", "text"), [(0.2345, "0.234"), (45.67, "45.7"), (612.3, "612"), (1234.0, "1.23k"), (523456.0, "523k")]
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert str(Spread(value, value, value)) == f"{text} ({text}–{text})"


def test_the_machine_is_named() -> None:
    machine = report.this_machine()
    assert machine.processor
    assert re.fullmatch(r"\d+\.\d+\.\d+.*", machine.python)


def stepped(rates: dict[int, float], ratio: float = 1.0) -> Stepping:
    """What a benchmark would say of vector environments with these steps per second."""

    def row(name: str, environments: int, rate: float) -> Row:
        return Row(name, environments, *[Spread(rate, rate, rate)] * 2, *[Spread(ratio, ratio, ratio)] * 2, "")

    vectors = [row("passloc, vector", size, rate) for size, rate in rates.items()]
    return Stepping("BearingDoppler", 1, 0.1, [row("FilterPy environment", 1, 5e3), *vectors], [])


def test_ratios_below_their_floors_are_told() -> None:
    floor = FLOORS["passloc, vector", 256]
    assert shortfalls(stepped({256: 1e5, 16: 1e5}, floor)) == []
    (line,) = shortfalls(stepped({256: 1e5, 16: 1e5}, 0.5 * floor))
    found = f"{0.5 * floor:g} times the FilterPy environment"
    assert line == f"passloc, vector, N = 256: {found}, must be at least {floor:g}"


def test_the_guard_fails_after_everything_is_shown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = dataclasses.replace(benchmark.measure(TINY), stepping=stepped({256: 1e5}, 1.0))
    monkeypatch.setattr(benchmark, "measure", lambda arguments, date: slow)
    words = ["bench", "--guard", "--json", str(tmp_path / "all.json"), "--out", str(tmp_path / "page")]
    assert main(words) == 1
    assert "N = 256: 1 times" in capsys.readouterr().err
    assert json.loads((tmp_path / "all.json").read_text())["stepping"]["scenario"] == "BearingDoppler"
    assert (tmp_path / "page" / "README.md").exists()


def test_the_growth_is_fitted_where_it_should_be_linear() -> None:
    """Cost N^1.5 above 1024, whatever is below."""
    rates = {16: 7.0, **{size: size**-0.5 for size in (1024, 2048, 16384)}}
    assert exponent(stepped(rates)) == pytest.approx(1.5, abs=1e-12)
    assert exponent(stepped({256: 1.0, 1024: 1.0})) is None


def test_the_page_holds_tables_and_a_figure(results: Results, tmp_path: Path) -> None:
    write_page(results, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert results.command in text
    assert "FilterPy environment" in text
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")
