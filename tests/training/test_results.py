"""Results per episode: a run that is cut short goes on where it stopped, and comes to what it would have come to."""

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rich")
pytest.importorskip("pyarrow")

import pyarrow
from pyarrow import parquet

from agents import find_policy
from passloc_env import SCENARIOS
from passloc_env.errors import InputError
from training import evaluate as evaluate_module
from training import files, statistics
from training import results as results_module
from training.engines.local import Local
from training.episodes import Scores
from training.evaluate import compare, evaluate
from training.results import ScoresOnDisk, opened_results
from training.statistics import Bootstrap, root_mean_square

ROOT = Path(__file__).parents[2]
SHORT = SCENARIOS["BearingsOnly"].override({"episode.steps": 24})
NAMES = ("circle", "random")
POLICIES = [find_policy(name, SHORT) for name in NAMES]
EPISODES, SEED, BATCH = 19, 90, 4
FILES = 10
"""Of two policies' nineteen episodes in batches of four."""


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    monkeypatch.setattr(results_module, "BATCH", BATCH)


@pytest.fixture(scope="module")
def expected():
    return evaluate(SHORT, POLICIES, EPISODES, SEED)


def evaluated(folder, **changes):
    return evaluate(SHORT, POLICIES, EPISODES, SEED, folder=folder, **changes)


def same(found, expected):
    """Verdicts and scores, all but the time that policies took."""
    for verdict, wanted in zip(found.verdicts, expected.verdicts, strict=True):
        assert {**vars(verdict), "milliseconds_per_decision": 0.0} == {**vars(wanted), "milliseconds_per_decision": 0.0}
    for name, scores in expected.scores.items():
        for quantity, values in vars(scores).items():
            np.testing.assert_array_equal(getattr(found.scores[name], quantity), values)


def files_in(folder):
    return sorted(folder.rglob("*.parquet"))


def test_a_row_for_every_episode(tmp_path, expected):
    same(evaluated(tmp_path), expected)
    files = files_in(tmp_path)
    assert len(files) == FILES
    assert [path.parent.name for path in files[::5]] == ["0-circle", "1-random"]
    rows = [row for path in files[:5] for row in parquet.read_table(path).to_pylist()]
    assert [row["seed"] for row in rows] == list(range(SEED, SEED + EPISODES))
    assert [row["end_error"] for row in rows] == expected.scores["circle"].end_error.tolist()
    columns = [field.name for field in dataclasses.fields(Scores)]
    assert list(rows[0]) == ["seed", *columns, "seconds_per_decision"]


def test_several_workers_write_the_same(tmp_path, expected):
    engine = Local(2)
    try:
        same(evaluated(tmp_path, engine=engine), expected)
    finally:
        engine.close()
    assert len(files_in(tmp_path)) == FILES


def test_an_interrupted_run_goes_on(tmp_path, expected, monkeypatch):
    """Stopped twice, between batches and within one; a half-written file counts for nothing."""
    flown = []
    real = evaluate_module.fly_batch

    def counting(scenario, policy, seed, first, count):
        if len(flown) in (3, 7):
            flown.append(None)
            raise KeyboardInterrupt
        flown.append((policy.name, first))
        return real(scenario, policy, seed, first, count)

    monkeypatch.setattr(evaluate_module, "fly_batch", counting)
    for whole in (3, 6):
        with pytest.raises(KeyboardInterrupt):
            evaluated(tmp_path)
        assert len(files_in(tmp_path)) == whole
    left = [tmp_path / ".settings.12345.part.json", tmp_path / "1-random" / ".000000008.12345.part.parquet"]
    for path in left:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"half")
    done = []
    same(evaluated(tmp_path, progress=lambda policy, count: done.append(count)), expected)
    assert sum(done) == 2 * EPISODES
    batches = [batch for batch in flown if batch]
    assert len(batches) == len(set(batches)) == FILES
    assert not any(path.exists() for path in left)
    same(evaluated(tmp_path), expected)
    assert len(flown) == FILES + 2


@pytest.mark.parametrize("workers", [1, 2])
def test_a_killed_run_goes_on(tmp_path, expected, workers):
    """Killed in the middle of the work, with its workers' answers under way."""
    program = (
        "import time\n"
        "from training import results\n"
        "from training.commands.fields import Work\n"
        "from training.engines import opened\n"
        "from test_results import POLICIES, SHORT, EPISODES, SEED, BATCH\n"
        "from training.evaluate import evaluate\n"
        "from pathlib import Path\n"
        "if __name__ == '__main__':\n"
        f"    results.BATCH = BATCH\n"
        f"    with opened(Work(workers={workers})) as engine:\n"
        f"        evaluate(SHORT, POLICIES, EPISODES, SEED, lambda *done: time.sleep(0.3), engine, Path('kept'))\n"
    )
    (tmp_path / "script.py").write_text(program, encoding="utf-8")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(Path(__file__).parent)])
    process = subprocess.Popen([sys.executable, "script.py"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": path})
    folder = tmp_path / "kept"
    for _ in range(1200):
        if len(files_in(folder)) >= 3:
            break
        time.sleep(0.05)
    with pytest.raises(InputError, match="is being written by another process"):
        evaluated(folder)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    kept = {path: path.stat().st_mtime_ns for path in files_in(folder)}
    assert 3 <= len(kept) < FILES
    same(evaluated(folder), expected)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"scenario": SHORT.override({"episode.steps": 28})}, "scenario"),
        ({"policies": [find_policy("circle", SHORT), find_policy("straight", SHORT)]}, "policies"),
        ({"policies": POLICIES[::-1]}, "policies"),
        ({"episodes": EPISODES + 1}, "episodes"),
        ({"seed": SEED + 1}, "seed"),
    ],
    ids=["scenario", "policies", "order", "episodes", "seed"],
)
def test_a_folder_of_other_settings_is_refused(tmp_path, change, named):
    evaluated(tmp_path)
    settings = {"scenario": SHORT, "policies": POLICIES, "episodes": EPISODES, "seed": SEED, **change}
    with pytest.raises(InputError, match=f"holds results of other {named}: name another folder with --results"):
        evaluate(**settings, folder=tmp_path)


@pytest.mark.parametrize(("name", "said"), [("else.txt", "not an empty folder"), ("settings.json", "cannot be read")])
def test_a_folder_of_something_else_is_refused(tmp_path, name, said):
    (tmp_path / name).write_text("precious", encoding="utf-8")
    with pytest.raises(InputError, match=said):
        evaluated(tmp_path)
    assert (tmp_path / name).read_text(encoding="utf-8") == "precious"


def test_results_of_another_version_are_refused(tmp_path, monkeypatch):
    evaluated(tmp_path)
    monkeypatch.setattr(results_module, "__version__", "0.0.0")
    with pytest.raises(InputError, match="holds results of other version"):
        evaluated(tmp_path)


def test_a_folder_whose_beginning_was_killed_is_begun_anew(tmp_path, expected):
    """What was left half-written, as ``appearing`` names it, is nobody's."""
    with files.appearing(tmp_path / "elsewhere" / "settings.json") as partial:
        left = tmp_path / partial.name
        partial.parent.mkdir()
        partial.touch()
    shutil.rmtree(partial.parent)
    left.write_text("{", encoding="utf-8")
    same(evaluated(tmp_path), expected)
    assert not left.exists()


def test_a_file_of_other_episodes_is_named(tmp_path):
    evaluation = evaluated(tmp_path)
    first, second = files_in(tmp_path / "0-circle")[:2]
    first.write_bytes(second.read_bytes())
    with pytest.raises(InputError, match=f"{first.name} cannot be read: remove it"):
        evaluation.scores["circle"].end_error.sum()


def test_a_refused_folder_is_left_as_it_is(tmp_path):
    """Not even what looks half-written is removed where nothing of ours is, nor a lock left there."""
    theirs = [".thesis.partial", ".notes.1.part", "project/.clone.7.part.json", "0-circle/.000000008.1.part.parquet"]
    for name in (*theirs, "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("precious", encoding="utf-8")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    with pytest.raises(InputError, match="is not an empty folder"):
        evaluated(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_a_link_is_not_written_through(tmp_path):
    folder, elsewhere = tmp_path / "kept", tmp_path / "elsewhere"
    evaluated(folder)
    (folder / "0-circle").rename(elsewhere)
    (folder / "0-circle").symlink_to(elsewhere)
    (elsewhere / "000000000.parquet").unlink()
    with pytest.raises(InputError, match="0-circle is a link: name another folder"):
        evaluated(folder)
    assert not (elsewhere / "000000000.parquet").exists()


SEEDS = np.arange(SEED, SEED + BATCH)
STRANGE = {
    "texts": {"seed": SEEDS, "end_error": ["1.0"] * BATCH},
    "lists": {"seed": SEEDS, "end_error": [[1.0]] * BATCH},
    "nothing": {"seed": SEEDS, "end_error": pyarrow.array([1.0, None, 1.0, 1.0])},
    "whole numbers": {"seed": SEEDS, "end_error": SEEDS},
    "instants": {"seed": SEEDS, "end_error": SEEDS.astype("datetime64[s]")},
    "too many": {"seed": np.arange(SEED, SEED + 9), "end_error": np.zeros(9)},
    "no seeds": {"end_error": np.zeros(BATCH)},
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_holds_no_scores_is_named(tmp_path, name):
    evaluation = evaluated(tmp_path)
    path = files_in(tmp_path / "0-circle")[0]
    parquet.write_table(pyarrow.table(STRANGE[name]), path)
    with pytest.raises(InputError, match=f"{path.name} cannot be read: remove it"):
        evaluation.scores["circle"].end_error.sum()


def test_a_pipe_is_not_waited_for(tmp_path):
    evaluation = evaluated(tmp_path)
    path = files_in(tmp_path / "0-circle")[0]
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(InputError, match=f"{path.name} cannot be read: remove it"):
        evaluation.scores["circle"].end_error.sum()


def test_a_second_process_is_refused(tmp_path, expected):
    with (
        opened_results(tmp_path, SHORT, NAMES, POLICIES, EPISODES, SEED),
        pytest.raises(InputError, match="is being written by another process"),
    ):
        evaluated(tmp_path)
    same(evaluated(tmp_path), expected)


def test_a_damaged_file_is_named(tmp_path):
    evaluation = evaluated(tmp_path)
    damaged = files_in(tmp_path)[1]
    damaged.write_bytes(damaged.read_bytes()[:100])
    with pytest.raises(InputError, match=f"{damaged.name} cannot be read: remove it"):
        evaluation.scores["circle"].end_error.sum()
    damaged.unlink()
    assert len(evaluated(tmp_path).scores["circle"].end_error) == EPISODES


def peak_of(work):
    """The most memory that Python and NumPy held while some work was done, bytes."""
    tracemalloc.start()
    try:
        work()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak


@pytest.mark.parametrize(("statistic", "columns"), [(np.mean, 0), (np.median, 2), (root_mean_square, 2)])
def test_resampling_takes_no_more_memory_for_many_episodes(statistic, columns):
    """A resample of a million would be 8 MB of indices; beside columns of 8 MB each no more than 5 MB is allowed."""
    values = np.random.default_rng(0).normal(size=1_000_000)
    bootstrap = Bootstrap(len(values), resamples=3)
    assert peak_of(lambda: bootstrap.estimate(values, statistic)) < columns * values.nbytes + 5e6


def test_judging_holds_a_column_at_a_time(tmp_path, monkeypatch):
    """Of 2 · 10 columns three at once at most, those of a difference, and 5 MB; all of them would be 53 MB."""
    monkeypatch.setattr(results_module, "BATCH", 1 << 16)
    monkeypatch.setattr(evaluate_module, "Bootstrap", lambda episodes: Bootstrap(episodes, resamples=3))
    monkeypatch.setattr(statistics, "_HELD", 1)
    episodes, rng = 400_000, np.random.default_rng(0)
    with opened_results(tmp_path, SHORT, NAMES, POLICIES, episodes, SEED) as results:
        for name in NAMES:
            for first, count in results.batches:
                columns = {field.name: rng.random(count) for field in dataclasses.fields(Scores)}
                flags = {name: rng.random(count) < 0.5 for name in ("lost", "violated")}
                results.keep(name, first, Scores(**columns | flags), 1e-6)
        stored = ScoresOnDisk(results)
        held = {name: Scores(**{each: getattr(stored[name], each) for each in columns}) for name in NAMES}
        seconds = dict.fromkeys(NAMES, 1e-6)
        evaluations = []
        assert peak_of(lambda: evaluations.append(compare(SHORT, stored, seconds))) < 3 * 8 * episodes + 5e6
    assert evaluations[0].verdicts == compare(SHORT, held, seconds).verdicts
