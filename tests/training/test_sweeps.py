"""Several agents trained one after the other or side by side: a sweep killed within one of them goes on within it."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

from small_trainings import EVERY, SHORT, SWEPT, TINY, Stopped, without_clock

from passloc_env.errors import InputError
from training import candidate as candidate_module
from training import files
from training.candidate import Candidate, train_missing
from training.checkpoint import LATEST, CheckpointError, find_checkpoint
from training.commands import Seeds
from training.curve import read_curve
from training.engines.alone import Alone
from training.hyperparameters import Hyperparameters
from training.lock import held
from training.run_folder import CONFIGURATION
from training.seeds import seeds
from training.train import run

ROOT = Path(__file__).parents[2]

SWEEP = """
import sys, time
from pathlib import Path
from small_trainings import EVERY, SWEPT
from training import candidate, checkpoint_callback
from training.commands import Seeds
from training.commands.fields import Work
from training.hyperparameters import Hyperparameters
from training.seeds import seeds

def save_slowly(folder):
    time.sleep(0.2)

candidate._CHECKPOINT = EVERY
checkpoint_callback.note = save_slowly
Hyperparameters.for_scenario = classmethod(lambda cls, name: SWEPT)
if __name__ == "__main__":
    seeds(Seeds(seeds=(3, 5), episodes=16, out=Path(sys.argv[1]), work=Work(workers=int(sys.argv[2]))))
"""


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch):
    """Short training with a checkpoint at every rollout; no log folder of SB3's."""
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path / "logs"))
    monkeypatch.setattr(candidate_module, "_CHECKPOINT", EVERY)
    monkeypatch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: SWEPT))


def judged(out: Path) -> dict:
    """The evaluation of a sweep without what differs from run to run: where it came from, and times."""
    data = json.loads((out / "BearingsOnly.json").read_text(encoding="utf-8"))
    for verdict in data["policies"]:
        del verdict["milliseconds_per_decision"]
    del data["provenance"]
    return data


def curve_kept(agent: Path) -> list[dict[str, float]]:
    """The rows of the learning curve in the last checkpoint of an agent that is being trained."""
    try:
        rows: list[dict[str, float]] = find_checkpoint(agent, lambda found: found)[0].tree["curve"]
    except CheckpointError:
        return []
    return rows


def killed_within(agent: Path, out: Path, workers: int) -> None:
    """Begin a sweep, and kill all its processes once an agent has learnt something that is kept."""
    script = out.with_name("sweep.py")
    script.write_text(SWEEP, encoding="utf-8")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    words = [sys.executable, str(script), str(out), str(workers)]
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(words, env=environment, start_new_session=True)
    for _ in range(2400):
        if len(curve_kept(agent)) >= 2 or process.poll() is not None:
            break
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL


@pytest.mark.parametrize("workers", [1, 2])
def test_a_killed_sweep_goes_on_within_the_agent(tmp_path: Path, workers: int) -> None:
    """Agents and scores are those of a sweep that nothing happened to; times of the first rows show what was kept."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    seeds(Seeds(seeds=(3, 5), episodes=16, out=whole))
    partial = out / "BearingsOnly-5.partial"
    killed_within(partial, out, workers)
    first = out / "BearingsOnly-3"
    assert first.exists() or workers == 2
    kept = curve_kept(partial)
    assert len(kept) >= 2
    before = first.stat().st_mtime_ns if first.exists() else None
    seeds(Seeds(seeds=(3, 5), episodes=16, out=out))
    assert {path.name for path in out.iterdir()} == {path.name for path in whole.iterdir()}
    for name in ("BearingsOnly-3", "BearingsOnly-5"):
        assert without_clock(out / name) == without_clock(whole / name)
        assert {path.name for path in (out / name).iterdir()} == {path.name for path in (whole / name).iterdir()}
    assert judged(out) == judged(whole)
    assert before is None or first.stat().st_mtime_ns == before
    curve = read_curve(out / "BearingsOnly-5" / "curve.csv")
    assert curve["seconds"][: len(kept)].tolist() == [row["seconds"] for row in kept]
    assert len(curve["seconds"]) > len(kept)


@pytest.fixture
def candidate(tmp_path: Path) -> Candidate:
    return Candidate("one", SHORT, TINY, 5, tmp_path / "out" / "one")


@pytest.fixture
def cut(candidate: Candidate) -> Path:
    """Where its training stopped half-way."""

    def stop(row: dict[str, float]) -> None:
        if row["decisions"] >= 1000:
            raise Stopped

    partial = candidate.folder.with_name("one.partial")
    partial.mkdir(parents=True)
    with pytest.raises(Stopped):
        run(SHORT, TINY, partial, seed=5, watch=stop, checkpoint=EVERY)
    return partial


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 6},
        {"scenario": SHORT.override({"episode.steps": 44})},
        {"parameters": dataclasses.replace(TINY, epochs=2)},
    ],
    ids=["seed", "scenario", "parameters"],
)
def test_a_training_begun_otherwise_is_refused_before_anything_is_trained(change, candidate: Candidate, cut: Path):
    other = dataclasses.replace(candidate, **change)
    new = dataclasses.replace(candidate, folder=candidate.folder.with_name("new"))
    before = (cut / LATEST).read_bytes()
    with pytest.raises(
        InputError, match=r"one.partial holds an agent trained otherwise: name another folder with --out"
    ):
        train_missing([new, other], candidate.folder.parent)
    assert not new.folder.exists()
    assert (cut / LATEST).read_bytes() == before


def test_a_sweep_under_way_elsewhere_is_refused(candidate: Candidate, cut: Path) -> None:
    """Even where the training that is begun there has nothing yet that could be gone on with."""
    (cut / CONFIGURATION).unlink()
    with held(candidate.folder.parent), pytest.raises(InputError, match=r"out is being written by another process"):
        train_missing([candidate], candidate.folder.parent)
    assert (cut / LATEST).exists()


def test_a_training_under_way_elsewhere_is_refused(candidate: Candidate, cut: Path) -> None:
    with held(cut), pytest.raises(InputError, match=r"one.partial is being written by another process"):
        train_missing([candidate], candidate.folder.parent)
    train_missing([candidate], candidate.folder.parent)
    assert candidate.trained


def test_what_was_finished_but_for_its_name_gets_it(candidate: Candidate, cut: Path) -> None:
    train_missing([candidate], candidate.folder.parent)
    written = (candidate.folder / "agent.json").stat().st_mtime_ns
    candidate.folder.replace(cut)
    assert not candidate.trained
    train_missing([candidate], candidate.folder.parent)
    assert (candidate.folder / "agent.json").stat().st_mtime_ns == written


def test_what_was_not_begun_is_begun_anew(candidate: Candidate) -> None:
    partial = candidate.folder.with_name("one.partial")
    partial.mkdir(parents=True)
    (partial / "curve.csv").write_text("half", encoding="utf-8")
    (partial / "else.txt").write_text("half", encoding="utf-8")
    train_missing([candidate], candidate.folder.parent)
    assert not (candidate.folder / "else.txt").exists()
    assert read_curve(candidate.folder / "curve.csv")["decisions"][-1] == TINY.decisions


class Away(Alone):
    """A place that does not see the files of this one."""

    sees_files = False


def test_an_agent_trained_away_is_the_same(candidate: Candidate, tmp_path: Path) -> None:
    there = dataclasses.replace(candidate, folder=tmp_path / "there" / "one")
    train_missing([candidate], candidate.folder.parent)
    train_missing([there], there.folder.parent, Away())
    assert without_clock(there.folder) == without_clock(candidate.folder)
    assert sorted(path.name for path in there.folder.parent.iterdir()) == [".lock", "one"]


def test_what_is_said_to_be_saved_is_where_it_is(candidate: Candidate) -> None:
    files.forget()
    train_missing([candidate], candidate.folder.parent)
    assert files.saved() == [str(candidate.folder)]
