"""Training that survives: killed at any moment and gone on with, it ends as if nothing had happened, to the last bit.

``pytest tests/training/test_resume.py --kills 20`` kills twenty times.
"""

import csv
import errno
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from small_trainings import SHORT, TINY, Stopped, without_clock

from agents import LearnedPolicy
from passloc_env.errors import InputError
from training import checkpoint, cli
from training.checkpoint import BEFORE, LATEST, Checkpoint, CheckpointError, find_checkpoint
from training.evaluate import evaluate
from training.lock import held
from training.run_folder import Assignment
from training.train import resume, run

ROOT = Path(__file__).parents[2]
EVERYTHING = """
decisions: 12000
environments: 32
rollout: 12
batch_size: 96
epochs: 2
network: [16, 16]
mirror: true
choices: 8
privileged_critic: true
violation_price: 20.0
shield_sigmas: 2.0
overrides: {sensors.Bearing.detection_probability: 0.9}
families:
- {target.start.speed: 200.0}
- {target.start.speed: {type: Uniform, low: 100.0, high: 250.0}, episode.min_range: 8000.0}
"""
"""All that has a memory: mirror, rising price, several families, random draws, Adam; and what has not beside it."""


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "training.cli", "train", *map(str, words), "-q"]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A run that nothing happened to, and how long it learnt."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "all.yaml").write_text(EVERYTHING, encoding="utf-8")
    words = command("BearingsOnly", "--hyperparameters", folder / "all.yaml", "--out", folder / "run")
    subprocess.run(words, check=True, env=environment())
    with (folder / "run" / "curve.csv").open(newline="") as file:
        return folder, float(list(csv.DictReader(file))[-1]["seconds"])


def killed(words: list[str], folder: Path, delay: float) -> bool:
    """Whether a training was alive when it was killed, so long after its folder appeared."""
    process = subprocess.Popen(words, env=environment())
    while not (folder / "config.json").exists():
        time.sleep(0.005)
    time.sleep(delay)
    process.kill()
    return process.wait() < 0


def test_killed_at_any_moment_it_ends_the_same(whole: tuple[Path, float], kill: int, tmp_path: Path) -> None:
    """Killed twice, the second time when it goes on already; the interval is that of one rollout or of several."""
    place, seconds = whole
    moments = random.Random(kill)
    words = ("--hyperparameters", place / "all.yaml", "--checkpoint", moments.choice([1, 1500, 5000]))
    folder = tmp_path / "run"
    alive = killed(command("BearingsOnly", *words, "--out", folder), folder, moments.uniform(0.0, 1.2 * seconds))
    if alive:
        alive = killed(command("--resume", folder), folder, moments.uniform(0.0, 1.2 * seconds))
    if alive:
        subprocess.run(command("--resume", folder), check=True, env=environment())
    assert without_clock(folder) == without_clock(place / "run")
    assert {path.name for path in folder.iterdir()} == {path.name for path in (place / "run").iterdir()}


def test_what_it_learnt_flies_the_same(whole: tuple[Path, float], tmp_path: Path) -> None:
    place, _ = whole
    folder = tmp_path / "run"
    killed(command("BearingsOnly", "--hyperparameters", place / "all.yaml", "--out", folder), folder, 0.5)
    if not (folder / "agent.json").exists():
        subprocess.run(command("--resume", folder), check=True, env=environment())
    flown = [evaluate(SHORT, [LearnedPolicy.load(each, SHORT)], episodes=8) for each in (folder, place / "run")]
    for name, values in vars(flown[0].scores["run"]).items():
        np.testing.assert_array_equal(values, getattr(flown[1].scores["run"], name))


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("straight")
    run(SHORT, TINY, folder, seed=5)
    return folder


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    """A run that stopped half-way, with two checkpoints."""
    folder = tmp_path / "cut"
    folder.mkdir()

    def stop(row: dict[str, float]) -> None:
        if row["decisions"] >= 1000:
            raise Stopped

    with pytest.raises(Stopped):
        run(SHORT, TINY, folder, seed=5, watch=stop, checkpoint=1)
    assert (folder / LATEST).exists()
    assert (folder / BEFORE).exists()
    return folder


@pytest.mark.parametrize("damage", ["nothing", "cut short", "flipped", "gone", "empty"])
def test_the_latest_whole_checkpoint_is_gone_on_from(damage: str, cut: Path, straight: Path, capsys) -> None:
    latest = cut / LATEST
    content = latest.read_bytes()
    if damage == "cut short":
        latest.write_bytes(content[: len(content) // 2])
    elif damage == "flipped":
        latest.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])
    elif damage == "gone":
        latest.unlink()
    elif damage == "empty":
        latest.write_bytes(b"")
    assert cli.main(["train", "--resume", str(cut), "-q"]) == 0
    assert without_clock(cut) == without_clock(straight)
    error = capsys.readouterr().err
    if damage in ("nothing", "gone"):
        assert error == ""
    else:
        assert f"{latest} is damaged" in error
        assert error.endswith("; going on from the one before\n")
        assert error.count("\n") == 1
    assert not (cut / LATEST).exists()


def test_two_damaged_checkpoints_are_one_line(cut: Path, capsys) -> None:
    for name in (LATEST, BEFORE):
        (cut / name).write_bytes((cut / name).read_bytes()[:100])
    before = {path.name: path.read_bytes() for path in cut.iterdir() if path.is_file()}
    assert cli.main(["train", "--resume", str(cut)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{cut / LATEST} is damaged" in error
    assert f"{cut / BEFORE} is damaged" in error
    assert {path.name: path.read_bytes() for path in cut.iterdir() if path.is_file()} == before


def test_a_full_disk_leaves_what_was_saved_before(cut: Path, straight: Path, monkeypatch, capsys) -> None:
    before = {name: (cut / name).read_bytes() for name in (LATEST, BEFORE)}

    def full(path: Path, content: bytes) -> None:
        path.write_bytes(content[:50])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "_write_through", full)
        assert cli.main(["train", "--resume", str(cut), "--checkpoint", "1", "-q"]) == 2
    error = capsys.readouterr().err
    assert error == (
        f"passloc: {cut / LATEST} cannot be written: No space left on device; "
        f"what was saved before is whole: passloc train --resume {cut}\n"
    )
    assert {name: (cut / name).read_bytes() for name in (LATEST, BEFORE)} == before
    assert cli.main(["train", "--resume", str(cut), "-q"]) == 0
    assert without_clock(cut) == without_clock(straight)


def test_a_limit_of_the_system_is_one_line(cut: Path) -> None:
    """A real one: no file may grow beyond what the operating system allows."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000))

    words = command("--resume", cut, "--checkpoint", 1)
    done = subprocess.run(words, env=environment(), preexec_fn=limit, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"passloc: {cut / LATEST} cannot be written: File too large; what was saved before")
    assert done.stderr.count("\n") == 1
    find_checkpoint(cut, lambda found: found)
    assert not list(cut.glob(".*.part"))


def test_a_checkpoint_of_another_training_is_one_line(cut: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "other").mkdir()
    with pytest.raises(Stopped):
        run(SHORT, TINY, tmp_path / "other", seed=6, watch=_stop, checkpoint=1)
    shutil.copy(tmp_path / "other" / LATEST, cut / LATEST)
    assert cli.main(["train", "--resume", str(cut)]) == 2
    error = capsys.readouterr().err
    assert error == f"passloc: {cut / LATEST} is of another training than config.json beside it describes\n"
    assert error.count("\n") == 1


def _stop(row: dict[str, float]) -> None:
    raise Stopped


def test_two_runs_cannot_write_one_folder(cut: Path, tmp_path: Path, capsys) -> None:
    with held(cut):
        assert cli.main(["train", "--resume", str(cut)]) == 2
        assert "is being written by another process" in capsys.readouterr().err
        with pytest.raises(InputError, match="is being written by another process"):
            run(SHORT, TINY, cut, seed=5)
    with held(cut):
        pass


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--resume", "nowhere"), "nowhere is not the folder of a training: it holds no config.json"),
        (("--resume", "{run}"), "is finished: there is nothing to go on with"),
        (("--resume", "{run}", "--seed", "3"), "seed is not possible with resume"),
        (("CrossFix", "--resume", "{run}"), "scenario is not possible with resume"),
        (("--checkpoint", "-1"), "checkpoint = -1 is not possible: must be at least 0"),
    ],
)
def test_what_cannot_be_gone_on_with_is_one_line(words, said, straight: Path, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["train", *(word.format(run=straight) for word in words)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_saved_nothing_begins_anew(straight: Path, tmp_path: Path) -> None:
    shutil.copy(straight / "config.json", tmp_path)
    resume(tmp_path, 0)
    assert without_clock(tmp_path) == without_clock(straight)


def test_an_interrupted_training_can_be_gone_on_with(straight: Path, tmp_path: Path) -> None:
    """Its agent is there already, and is replaced by what it becomes."""

    def interrupt(row: dict[str, float]) -> None:
        if row["decisions"] >= 1000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(SHORT, TINY, tmp_path, seed=5, watch=interrupt, checkpoint=500)
    assert json.loads((tmp_path / "agent.json").read_text())["training"]["decisions"] < TINY.decisions
    resume(tmp_path, 500)
    assert without_clock(tmp_path) == without_clock(straight)


def test_a_configuration_comes_back(straight: Path) -> None:
    again = Assignment.load(straight)
    assert (again.scenario, again.parameters, again.seed) == (SHORT, TINY, 5)


TREE = {
    "numbers": [1, 2.5, -0.0, 1e-300, 2**127, None, True, "word", [], {}],
    "arrays": {"scalar": np.array(0.1, np.float32), "empty": np.zeros((0, 3)), "flags": np.array([True, False])},
    "turned": np.arange(12.0).reshape(3, 4).T,
    "words": np.array([2**64 - 1], np.uint64),
}


def test_a_checkpoint_keeps_everything(tmp_path: Path) -> None:
    Checkpoint(TREE).save(tmp_path)
    tree = Checkpoint.load(tmp_path / LATEST).tree
    assert tree["numbers"] == TREE["numbers"]
    flat = {"turned": TREE["turned"], "words": TREE["words"], **TREE["arrays"]}
    for name, array in flat.items():
        found = tree[name] if name in tree else tree["arrays"][name]
        assert (found.dtype, found.shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(found, array)


@pytest.mark.parametrize("at", range(0, 400, 13))
def test_every_cut_and_every_flipped_bit_is_noticed(at: int, tmp_path: Path) -> None:
    Checkpoint(TREE).save(tmp_path)
    content = (tmp_path / LATEST).read_bytes()
    place = at * len(content) // 400
    flipped = content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :]
    for damaged in (content[:place], flipped):
        (tmp_path / LATEST).write_bytes(damaged)
        with pytest.raises(CheckpointError, match=r"is damaged|cannot be read"):
            Checkpoint.load(tmp_path / LATEST)
