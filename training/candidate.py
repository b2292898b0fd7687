"""Agents that are trained side by side to be compared, each trained once and kept."""

from __future__ import annotations

import dataclasses
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents import LearnedPolicy
from agents.agent_file import AgentFile
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from training.arguments import kept_folder
from training.commands import Train
from training.engines import ALONE, Engine
from training.files import move_whole, note
from training.hyperparameters import Hyperparameters
from training.lock import held
from training.progress import console, progress_bar
from training.run_folder import CONFIGURATION, Assignment
from training.train import finished, resume, run

_CHECKPOINT = Train.checkpoint
"""Decisions between checkpoints, as of a training by itself."""


@dataclass(frozen=True)
class Candidate:
    """A way of training: on what, how, from which seed, and where the agent is kept.

    Attributes:
        name: what tables call the agent.
        scenario: what it is trained on, before the overrides of the hyperparameters.
        parameters: how.
        seed: of everything random.
        folder: of its run.
    """

    name: str
    scenario: Scenario
    parameters: Hyperparameters
    seed: int
    folder: Path

    @property
    def trained(self) -> bool:
        """Whether the agent is there already.

        Raises:
            AgentFileError: the folder holds something else.
            InputError: the folder holds an agent of other settings.
        """
        if not self.folder.exists():
            return False
        agent = AgentFile.load(self.folder)
        training = agent.card.get("training", {})
        self._keep_to(self.folder, agent.scenario, training.get("hyperparameters"), training.get("seed"))
        return True

    @property
    def begun(self) -> bool:
        """Whether its training was begun and cut short.

        Raises:
            InputError: it was begun with other settings.
        """
        if not (self._partial / CONFIGURATION).exists():
            return False
        found = Assignment.load(self._partial)
        self._keep_to(self._partial, found.scenario, dataclasses.asdict(found.parameters), found.seed)
        return True

    def train(self, quiet: bool = False) -> None:
        """Train the agent, or go on with its training that was cut short; its folder appears when it is finished."""
        if not self.begun:
            run(self.scenario, self.parameters, self._emptied(), self.seed, quiet, checkpoint=_CHECKPOINT)
        elif not finished(self._partial):
            resume(self._partial, _CHECKPOINT, quiet)
        move_whole(self._partial, self.folder)

    def bring_home(self, files: Mapping[str, bytes]) -> None:
        """Write the agent's folder as :func:`train_away` gives it; it appears whole or not at all."""
        partial = self._emptied()
        for name, content in files.items():
            path = partial / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        move_whole(partial, self.folder)

    @property
    def _partial(self) -> Path:
        """Where it is trained."""
        return self.folder.with_name(self.folder.name + ".partial")

    def _emptied(self) -> Path:
        """Where it is trained, with nothing in it."""
        shutil.rmtree(self._partial, ignore_errors=True)
        self._partial.mkdir()
        return self._partial

    def _keep_to(self, folder: Path, scenario: Scenario, parameters: Any, seed: Any) -> None:
        """InputError unless scenario, hyperparameters and seed that were found in a folder are those wanted.

        Scenarios are compared by what they mean: in a file older than one of its fields that has its default.
        """
        wanted = json.loads(json.dumps(dataclasses.asdict(self.parameters)))
        same = scenario == self.scenario.override(self.parameters.overrides) and seed == self.seed
        if not same or json.loads(json.dumps(parameters)) != wanted:
            raise InputError(f"{folder} holds an agent trained otherwise: name another folder with --out")

    @property
    def policy(self) -> LearnedPolicy:
        """The trained agent under its name in tables."""
        return LearnedPolicy(AgentFile.load(self.folder), self.name)


def train_here(candidate: Candidate) -> None:
    """Train an agent in its own place, which this process sees."""
    candidate.train(quiet=True)


def train_away(candidate: Candidate) -> dict[str, bytes]:
    """Train an agent where its folder need not exist, such as on another machine; the files of its run by name."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "agent"
        dataclasses.replace(candidate, folder=folder).train(quiet=True)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def train_missing(candidates: Sequence[Candidate], out: Path, engine: Engine = ALONE) -> None:
    """Train those that are not there yet; one whose training was cut short is gone on with, if that was here.

    Raises:
        AgentFileError: a candidate's folder holds something else.
        InputError: a candidate's folder holds an agent of other settings, or its training was begun with others, or
            another sweep is under way; nothing has been trained then.
        FileExistsError: ``out``, which holds the folders, is a file.
    """
    # Twice: what is refused is refused before anything is left there, and what is missing is known once nobody adds.
    _waiting(candidates)
    with held(kept_folder(out)):
        _train(*_waiting(candidates), engine)


def _waiting(candidates: Sequence[Candidate]) -> tuple[list[Candidate], list[str]]:
    """Those that are not there yet, and the names of those that are begun."""
    waiting = [candidate for candidate in candidates if not candidate.trained]
    return waiting, [candidate.name for candidate in waiting if candidate.begun]


def _train(waiting: Sequence[Candidate], begun: Sequence[str], engine: Engine) -> None:
    if engine is not ALONE:
        _train_beside(waiting, engine)
        return
    for number, candidate in enumerate(waiting, 1):
        what = "going on with" if candidate.name in begun else "training"
        console.print(f"{what} {number}/{len(waiting)}: {candidate.name}", highlight=False)
        candidate.train()


def _train_beside(waiting: Sequence[Candidate], engine: Engine) -> None:
    """Train several at once."""
    tasks = [(candidate,) for candidate in waiting]
    with progress_bar("agents") as bar:
        task = bar.add_task("training", total=len(waiting))
        if engine.sees_files:
            for index, _ in engine.map(train_here, tasks):
                note(waiting[index].folder)
                bar.advance(task)
        else:
            for index, files in engine.map(train_away, tasks):
                waiting[index].bring_home(files)
                bar.advance(task)
