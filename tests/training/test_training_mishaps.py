"""What ends a training before its time is one line that says the truth about what is left."""

import dataclasses
import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from small_trainings import SHORT, TINY, without_clock

from passloc_env.errors import InputError
from training import checkpoint, cli, event_log
from training.checkpoint import LATEST
from training.curve import COLUMNS, CURVE_LIMIT, read_curve
from training.files import write_whole
from training.hyperparameters import Hyperparameters
from training.run_folder import CURVE
from training.train import finished, resume, run


@pytest.fixture
def words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """A short training on the command line, into the folder "run"."""
    monkeypatch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: TINY))
    return ["train", "BearingsOnly", "--override", "episode.steps=40", "--out", str(tmp_path / "run"), "-q"]


def line(capsys: pytest.CaptureFixture[str]) -> str:
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def interrupt(*arguments: object, **keywords: object) -> None:
    raise KeyboardInterrupt


def full(*arguments: object, **keywords: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("place", ["training.event_log.configure", "training.vector_ppo.VectorPPO._setup_learn"])
def test_ctrl_c_before_anything_is_learnt_leaves_no_agent(place, words, tmp_path, monkeypatch, capsys) -> None:
    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(place, interrupt)
        assert cli.main(words) == 130
        assert line(capsys) == f"passloc: interrupted; saved so far: {folder / 'config.json'}\n"
        assert not (folder / "agent.json").exists()
        assert cli.main(["train", "--resume", str(folder), "-q"]) == 130
        assert line(capsys).startswith("passloc: interrupted; ")
    assert cli.main(["train", "--resume", str(folder), "-q"]) == 0
    assert finished(folder)


def test_ctrl_c_in_the_first_rollout_leaves_no_agent(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(SHORT, TINY, tmp_path, seed=5, watch=interrupt, checkpoint=1)
    assert not (tmp_path / "agent.json").exists()
    assert (tmp_path / LATEST).exists()


def test_the_logger_that_cannot_begin_leaves_threads_alone(tmp_path: Path, monkeypatch) -> None:
    import threading

    before = threading.excepthook
    monkeypatch.setattr(event_log, "configure", full)
    with pytest.raises(OSError, match="No space left"), event_log.event_log(tmp_path):
        pass
    assert threading.excepthook is before


@pytest.mark.parametrize("choices", [0, 4])
@pytest.mark.parametrize("every", [0, 1])
def test_a_learner_that_diverges_is_one_line(every, choices, words, tmp_path, monkeypatch, capsys) -> None:
    wild = dataclasses.replace(TINY, learning_rate=1e20, choices=choices)
    monkeypatch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: wild))
    assert cli.main([*words, "--checkpoint", str(every)]) == 2
    error = line(capsys)
    assert "the learner has diverged after " in error
    assert "learning_rate = 1e+20 may be too large" in error
    last = f"the last checkpoint is {tmp_path / 'run' / LATEST}" if every else "there is no checkpoint"
    assert error.endswith(f"; {last}\n")
    assert not (tmp_path / "run" / "agent.json").exists()


def test_another_fault_of_a_value_is_not_called_divergence(tmp_path: Path) -> None:
    def fault(row: dict[str, float]) -> None:
        raise ValueError("something else")

    with pytest.raises(ValueError, match=r"^something else$"):
        run(SHORT, TINY, tmp_path, seed=5, watch=fault)


def test_a_run_without_checkpoints_is_not_called_finished(tmp_path: Path, capsys) -> None:
    def stop(row: dict[str, float]) -> None:
        if row["decisions"] >= 1000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(SHORT, TINY, tmp_path, seed=5, watch=stop)
    done = json.loads((tmp_path / "agent.json").read_text(encoding="utf-8"))["training"]["decisions"]
    assert not finished(tmp_path)
    assert cli.main(["train", "--resume", str(tmp_path)]) == 2
    said = f"{tmp_path} was cut short after {done:,} of 1,920 decisions and kept no checkpoint to go on from"
    assert line(capsys) == f"passloc: {said}\n"


def test_a_disk_full_at_the_first_checkpoint_promises_nothing(words, tmp_path, monkeypatch, capsys) -> None:
    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "_write_through", full)
        assert cli.main(words) == 2
    assert line(capsys) == (
        f"passloc: {folder / LATEST} cannot be written: No space left on device; "
        f"no checkpoint was saved, it begins anew with: passloc train --resume {folder}\n"
    )
    resume(folder, 0)
    assert finished(folder)


def test_a_disk_full_at_the_curve_names_it(words, tmp_path, monkeypatch, capsys) -> None:
    """As where the disk fills between the first row and the next."""
    folder = tmp_path / "run"
    real = Path.open

    def no_room(path: Path, mode: str = "r", *arguments, **keywords):
        return full() if mode == "a" else real(path, mode, *arguments, **keywords)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", no_room)
        assert cli.main([*words, "--checkpoint", "1"]) == 2
    assert line(capsys) == (
        f"passloc: {folder / CURVE} cannot be written: No space left on device; "
        f"what was saved before is whole: passloc train --resume {folder}\n"
    )


def test_a_file_that_finds_no_room_is_named(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match=r"table\.md cannot be written: No space left on device$"):
        write_whole(tmp_path / "table.md", "words")
    assert list(tmp_path.iterdir()) == []


def test_a_long_curve_can_be_read(tmp_path: Path) -> None:
    """Of fifty thousand rollouts, which is more than a text may otherwise hold; a larger one than any is not."""
    row = "1000000,1234.567891,-12.345678,58.123456,0.012345\n"
    path = tmp_path / CURVE
    path.write_text(",".join(COLUMNS) + "\n" + row * 50_000, encoding="utf-8")
    assert path.stat().st_size > 1 << 20
    np.testing.assert_array_equal(read_curve(path)["mean_length"], np.full(50_000, 58.123456))
    with path.open("ab") as file:
        file.truncate(CURVE_LIMIT + 1)
    with pytest.raises(InputError, match="is not a learning curve: larger than the 16384 KiB"):
        read_curve(path)


@pytest.mark.parametrize(
    "words",
    [
        ("train", "--out", "runs/a", "--json", "runs/a"),
        ("train", "--out", "runs/a", "--json", "runs"),
        ("evaluate", "--results", "kept", "--json", "./kept"),
        ("seeds", "--json", "runs/seeds"),
    ],
)
def test_an_answer_in_the_place_of_a_folder_is_refused_at_the_door(words, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(list(words)) == 2
    error = line(capsys)
    assert error.startswith(f"passloc: json = '{words[-1].removeprefix('./')}' is not possible: ")
    assert error.endswith(" is written there\n")
    assert list(tmp_path.iterdir()) == []


def test_an_answer_beside_a_run_is_given(words, tmp_path) -> None:
    assert cli.main([*words, "--json", str(tmp_path / "answer.json")]) == 0
    assert json.loads((tmp_path / "answer.json").read_text(encoding="utf-8"))["folder"] == str(tmp_path / "run")


def test_a_resumed_learner_interrupted_at_once_keeps_its_agent(tmp_path, monkeypatch) -> None:
    """It has learnt before, and says so; the run ends as one that nothing happened to."""

    def stop(row: dict[str, float]) -> None:
        if row["decisions"] >= 1000:
            raise KeyboardInterrupt

    folders = tmp_path / "whole", tmp_path / "cut"
    for folder in folders:
        folder.mkdir()
    run(SHORT, TINY, folders[0], seed=5)
    with pytest.raises(KeyboardInterrupt):
        run(SHORT, TINY, folders[1], seed=5, watch=stop, checkpoint=1)
    with monkeypatch.context() as patch:
        patch.setattr(event_log, "configure", interrupt)
        with pytest.raises(KeyboardInterrupt):
            resume(folders[1], 1)
    card = json.loads((folders[1] / "agent.json").read_text(encoding="utf-8"))
    assert 0 < card["training"]["decisions"] < TINY.decisions
    assert card["training"]["seconds"] >= 0.0
    resume(folders[1], 1)
    assert without_clock(folders[1]) == without_clock(folders[0])
