"""Run folders from strangers: what is put back is what a training can have kept, and no link is followed."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from small_trainings import SHORT, TINY, Stopped, without_clock

from training import checkpoint, cli
from training import train as train_module
from training.checkpoint import BEFORE, LATEST, Checkpoint, CheckpointError
from training.train import run


def _stop(row: dict[str, float]) -> None:
    if row["decisions"] >= 1000:
        raise Stopped


def stopped(folder: Path, seed: int) -> Path:
    """A run that was killed half-way, with two checkpoints."""
    folder.mkdir()
    with pytest.raises(Stopped):
        run(SHORT, TINY, folder, seed=seed, watch=_stop, checkpoint=1)
    return folder


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Such runs by their seeds."""
    place = tmp_path_factory.mktemp("kept")
    return {seed: stopped(place / str(seed), seed) for seed in (5, 6)}


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("straight")
    run(SHORT, TINY, folder, seed=5)
    return folder


@pytest.fixture
def cut(kept: dict[int, Path], tmp_path: Path) -> Path:
    return shutil.copytree(kept[5], tmp_path / "cut")


def refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The line that refuses to go on with a run, of which nothing is changed."""
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    capsys.readouterr()
    assert cli.main(["train", "--resume", str(folder), "-q"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.isprintable() or error[:-1].isprintable()
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert {name: content for name, content in after.items() if name != ".lock"} == {
        name: content for name, content in before.items() if name != ".lock"
    }
    return error


def test_checkpoints_of_another_seed_are_refused(cut: Path, kept: dict[int, Path], capsys) -> None:
    for name in (LATEST, BEFORE):
        shutil.copy(kept[6] / name, cut / name)
    assert f"{cut / LATEST} is of another training than config.json beside it describes" in refused(cut, capsys)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("hyperparameters", "learning_rate"), 0.5),
        (("seed",), 7),
        (("scenario", "episode", "steps"), 44),
        (("provenance", "versions", "torch"), "1.0"),
    ],
)
def test_a_changed_configuration_is_refused(path: tuple[str, ...], value: object, cut: Path, capsys) -> None:
    data = json.loads((cut / "config.json").read_text(encoding="utf-8"))
    inner = data
    for name in path[:-1]:
        inner = inner[name]
    assert inner[path[-1]] != value
    inner[path[-1]] = value
    (cut / "config.json").write_text(json.dumps(data), encoding="utf-8")
    assert "is of another training than config.json beside it describes" in refused(cut, capsys)


def test_a_card_says_where_it_was_gone_on_with(cut: Path, straight: Path, monkeypatch, capsys) -> None:
    here = train_module.provenance([])
    elsewhere = here | {"versions": here["versions"] | {"numpy": "99.0"}}
    monkeypatch.setattr(train_module, "provenance", lambda words: elsewhere)
    assert cli.main(["train", "--resume", str(cut), "-q"]) == 0
    error = capsys.readouterr().err
    assert "was begun with other versions or on another machine" in error
    assert error.count("\n") == 1
    weights, curve, card = without_clock(cut)
    assert card["training"].pop("resumed") == [elsewhere]
    assert (weights, curve, card) == without_clock(straight)


Change = Callable[[dict[str, Any]], None]


def change(*path: str | int, to: object) -> Change:
    """A change of one leaf of a checkpoint."""

    def changed(tree: dict[str, Any]) -> None:
        inner: Any = tree
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = to(inner[path[-1]]) if callable(to) else to

    return changed


ENVIRONMENT = ("learner", "env", "inner", "inner", "own")
COUNTS = (*ENVIRONMENT, "env", "arrays", "simulation.step_count")
STRANGE = {
    "a text for a counter": change("learner", "counters", "num_timesteps", to="abc"),
    "a negative counter": change("learner", "counters", "num_timesteps", to=-1),
    "more than it was to learn": change("learner", "counters", "num_timesteps", to=10**90),
    "a curve of numbers": change("curve", to=[1, 2]),
    "a text for a curve": change("curve", to="xyz"),
    "a row too short": change("curve", 0, to={"decisions": 1}),
    "a text in a row": change("curve", 0, "decisions", to="1"),
    "a time that is none": change("seconds", to=float("nan")),
    "a time before the beginning": change("seconds", to=-1.0),
    "a text for a place": change("resumed", to=["here"]),
    "another observation": change("learner", "observation", to=lambda array: array[:, :-1]),
    "another type": change("learner", "observation", to=lambda array: array.astype(np.float64)),
    "a narrower network": change("learner", "policy", "action_net.weight", to=lambda array: array[:, :-1]),
    "moments of nothing": change("learner", "optimiser", "moments", to={"99": {}}),
    "moments of another shape": change("learner", "optimiser", "moments", "0", "exp_avg", to=np.zeros(3, np.float32)),
    "no optimiser": change("learner", "optimiser", to=[]),
    "a group that is none": change("learner", "optimiser", "param_groups", to=None),
    "no learner": change("learner", to=None),
    "a generator with too few words": change("learner", "generators", "python", 1, to=[1, 2]),
    "a generator with too large a word": change("learner", "generators", "python", 1, 0, to=2**70),
    "a position beyond the end": change("learner", "generators", "numpy", "position", to=2**70),
    "a position just beyond it": change("learner", "generators", "numpy", "position", to=625),
    "a step before the first": change(*COUNTS, to=lambda counts: counts - 10**7),
    "a step after the last": change(*COUNTS, to=lambda counts: counts + 10**7),
    "weights that are none": change("learner", "policy", "action_net.weight", to=lambda array: array * np.nan),
    "another state of torch": change("learner", "generators", "torch", to=lambda array: np.full_like(array, 255)),
    "another generator": change(*ENVIRONMENT, "env", "generators", 0, "bit_generator", to="MT19937"),
    "a generator of text": change(*ENVIRONMENT, "env", "generators", 0, "state", to="abc"),
    "too few environments": change(*ENVIRONMENT, "env", "generators", to=lambda states: states[:-1]),
    "an array for a number": change("seconds", to=np.zeros(2)),
    "something more": change("learner", "more", to=1),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_no_training_has_kept_is_one_line(name: str, cut: Path, straight: Path, capsys) -> None:
    """The digest is right; the checkpoint before is gone on from."""
    tree = Checkpoint.load(cut / LATEST).tree
    STRANGE[name](tree)
    (cut / LATEST).write_bytes(Checkpoint(tree)._content())
    assert cli.main(["train", "--resume", str(cut), "-q"]) == 0
    error = capsys.readouterr().err
    assert error.startswith(f"passloc: {cut / LATEST} is ")
    assert error.endswith("; going on from the one before\n")
    assert error.count("\n") == 1
    assert without_clock(cut) == without_clock(straight)


def test_too_large_a_checkpoint_is_neither_read_nor_written(cut: Path, monkeypatch, capsys) -> None:
    with (cut / LATEST).open("ab") as file:
        file.truncate(checkpoint.LIMIT + 1)
    with pytest.raises(CheckpointError, match="larger than the 1048576 KiB"):
        Checkpoint.load(cut / LATEST)
    (cut / LATEST).unlink()
    monkeypatch.setattr(checkpoint, "LIMIT", 1000)
    with pytest.raises(CheckpointError, match="would be larger than can be read again"):
        Checkpoint({"array": np.zeros(1000)}).save(cut)
    assert not (cut / LATEST).exists()


@pytest.mark.parametrize("content", [b"", b"\xff" * 16, b"\x02" + bytes(7) + b"[]", b"\x02" + bytes(7) + b"{}"])
def test_what_is_no_checkpoint_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / LATEST).write_bytes(content)
    with pytest.raises(CheckpointError, match="is damaged"):
        Checkpoint.load(tmp_path / LATEST)


NAMES = (LATEST, f".{LATEST}.part", "curve.csv", ".lock", "config.json", "agent.json", ".agent.1.json", "tensorboard")


@pytest.mark.parametrize("name", NAMES)
def test_links_are_not_followed(name: str, cut: Path, tmp_path: Path, capsys) -> None:
    path, victim = cut / name, tmp_path / "victim"
    if path.is_dir():
        shutil.rmtree(path)
        victim.mkdir()
    elif path.exists():
        path.replace(victim)
    else:
        victim.write_text("mine", encoding="utf-8")
    path.symlink_to(victim)
    before = [] if victim.is_dir() else victim.read_bytes()
    error = refused(cut, capsys)
    assert f"{path} is not a file of a training: it is a link" in error
    assert (list(victim.iterdir()) if victim.is_dir() else victim.read_bytes()) == before


def test_a_link_among_events_is_not_followed(cut: Path, tmp_path: Path, capsys) -> None:
    (cut / "tensorboard" / "events").symlink_to(tmp_path / "victim")
    assert "events is not a file of a training: it is a link" in refused(cut, capsys)


@pytest.mark.parametrize("name", [LATEST, "other"])
def test_pipes_are_not_waited_for(name: str, cut: Path, capsys) -> None:
    (cut / name).unlink(missing_ok=True)
    os.mkfifo(cut / name)
    assert "it is a pipe or a device" in refused(cut, capsys)
    with pytest.raises(CheckpointError, match="cannot be read: not a regular file"):
        Checkpoint.load(cut / name)


def test_a_partial_checkpoint_is_replaced_and_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine", encoding="utf-8")
    (tmp_path / f".{LATEST}.part").symlink_to(victim)
    Checkpoint({"number": 1}).save(tmp_path)
    assert victim.read_text(encoding="utf-8") == "mine"
    assert Checkpoint.load(tmp_path / LATEST).tree == {"number": 1}
    with pytest.raises(FileExistsError):
        checkpoint._write_through(tmp_path / LATEST, b"")


def test_many_environments_fit_into_a_checkpoint(tmp_path: Path) -> None:
    """As many values as four thousand environments and twenty thousand rollouts keep."""
    state = {"bit_generator": "PCG64", "state": {"state": 2**127, "inc": 1}, "has_uint32": 0, "uinteger": 0}
    row = dict.fromkeys(("decisions", "seconds", "mean_return", "mean_length", "violations"), 0.5)
    tree = {"generators": [state] * 4096, "curve": [row] * 20_000}
    Checkpoint(tree).save(tmp_path)
    assert Checkpoint.load(tmp_path / LATEST).tree == tree
