"""Every command in the README, the documentation and the help runs as it is written, only with less to do."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO

from passloc_env.sb3 import make_vec_env
from training import cli
from training.commands import (
    COMMANDS,
    Ablate,
    Bench,
    Card,
    Demo,
    Evaluate,
    Leaderboard,
    Replay,
    Report,
    Reproduce,
    Seeds,
    Soak,
    Train,
    Tune,
)
from training.papers.catalogue import find_papers
from training.parsing import described, parse

ROOT = Path(__file__).parents[1]
LESS: dict[type, dict[str, Any]] = {
    Train: {"decisions": 1},
    Demo: {"decisions": 1, "episodes": 8},
    Tune: {"trials": 1, "decisions": 1, "episodes": 8},
    Seeds: {"seeds": (0, 1), "decisions": 1, "episodes": 8},
    Ablate: {"decisions": 1, "episodes": 8},
    Evaluate: {"episodes": 4},
    # A name would put an agent of one rollout among the shipped ones.
    Card: {"episodes": 4, "name": ""},
    Report: {"episodes": 8},
    Leaderboard: {"scenarios": "CrossFix", "episodes": 2},
    Reproduce: {"runs": 2, "paper": "cross-fix"},
    Soak: {"steps": 1, "episodes": 2},
    Replay: {"override": ("episode.steps=40",)},
    Bench: {"sizes": (1,), "rounds": 1, "seconds": 1e-3, "workers": 1, "peers": False}
    | {"growth": False, "trackers": False, "learning": False, "guard": False},
}
"""What costs time, command by command."""

NEW = "new-scenario"
FIRST = [
    "passloc train BearingsOnly --seed 1 --out runs/mine",
    "passloc train BearingsOnly",
    "passloc evaluate BearingsOnly --policies circle,straight --json runs/evaluation.json",
    "passloc tune BearingsOnly",
]
"""What other commands begin from, beside scenario files."""


def written() -> dict[str, str]:
    """Every command once, and where it stands."""
    found: dict[str, str] = {}
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        for block in re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            for line in block.replace("\\\n", " ").splitlines():
                if line.startswith("passloc "):
                    found.setdefault(" ".join(shlex.split(line, comments=True)), str(page.relative_to(ROOT)))
    for name, command in COMMANDS.items():
        for line in re.findall(r"^ +(passloc .*)$", described(command.takes), re.MULTILINE):
            found.setdefault(" ".join(shlex.split(line)), f"{name} --help")
    return found


WRITTEN = written()


def with_less(command: str) -> Any:
    """The arguments of a command, changed so that it has less to do."""
    _, name, *words = shlex.split(command)
    arguments = parse(name, words)
    if isinstance(arguments, Reproduce):
        find_papers(arguments.paper)
    if getattr(arguments, "resume", None) is not None:
        # Such a run knows itself how much there is to do.
        return arguments
    return dataclasses.replace(arguments, **LESS.get(type(arguments), {}))


def different() -> list[str]:
    """Of commands that do the same when they have less to do, wherever they write to, the first."""
    found: dict[Any, str] = {}
    for command in WRITTEN:
        less = with_less(command)
        elsewhere = dataclasses.replace(less, out=None) if hasattr(less, "out") else less
        found.setdefault(elsewhere, command)
    return list(found.values())


@contextlib.contextmanager
def working_in(folder: Path) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield


def run(command: str) -> int:
    """The command with less to do, in this process."""
    _, name, *words = shlex.split(command)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cli, "parse", lambda name, words: with_less(command))
        return cli.main([name, *words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a reader might be, with what the commands begin from."""
    place = tmp_path_factory.mktemp("reader")
    scenarios = {parse("new-scenario", command.split()[2:]).file: command for command in WRITTEN if NEW in command}
    with working_in(place):
        model = PPO("MlpPolicy", make_vec_env("BearingsOnly", n_envs=2, seed=0), n_steps=2, batch_size=4, device="cpu")
        (place / "models").mkdir()
        model.save("models/ppo.zip")
        for command in (*scenarios.values(), *FIRST):
            assert run(command) == 0
        # Killed before its first checkpoint.
        Path("runs/cut-short").mkdir()
        shutil.copy("runs/mine/config.json", "runs/cut-short")
    return place


def test_they_are_found() -> None:
    assert {"README.md", "docs/guides/ecosystem.md", "train --help"} <= set(WRITTEN.values())
    assert {command.split()[1] for command in WRITTEN} == set(COMMANDS)


@pytest.mark.parametrize("command", different(), ids=lambda command: f"{WRITTEN[command]}: {command}")
def test_a_command_runs_as_written(command: str, folder: Path, tmp_path: Path) -> None:
    # Such a command has been through already, or refuses to write over what has.
    again = command in FIRST or NEW in command or re.search(r" --out runs/mine( |$)", command)
    with working_in(tmp_path if again else folder):
        if again and NEW not in command:
            assert run(f"passloc {NEW} runs/mine.yaml") == 0
        assert run(command) == 0
