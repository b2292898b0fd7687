"""Agents that are trained side by side to be compared, each trained once and kept."""

from __future__ import annotations

import dataclasses
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from agents import LearnedPolicy
from agents.agent_file import AgentFile
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from training.arguments import kept_folder
from training.engines import ALONE, Engine
from training.hyperparameters import Hyperparameters
from training.progress import console, progress_bar
from training.train import run


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
        # A card that is older than a field of its scenario means that field's default.
        same = agent.scenario == self.scenario.override(self.parameters.overrides)
        parameters = json.loads(json.dumps(dataclasses.asdict(self.parameters)))
        if not same or training.get("hyperparameters") != parameters or training.get("seed") != self.seed:
            raise InputError(f"{self.folder} holds an agent trained otherwise: name another folder with --out")
        return True

    def train(self, quiet: bool = False) -> None:
        """Train the agent; its folder appears when it is finished."""
        partial = self._partial()
        run(self.scenario, self.parameters, partial, self.seed, quiet)
        partial.replace(self.folder)

    def bring_home(self, files: Mapping[str, bytes]) -> None:
        """Write the agent's folder as :func:`train_away` gives it; it appears whole or not at all."""
        partial = self._partial()
        for name, content in files.items():
            path = partial / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        partial.replace(self.folder)

    def _partial(self) -> Path:
        """A new folder to fill."""
        partial = self.folder.with_name(self.folder.name + ".partial")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        return partial

    @property
    def policy(self) -> LearnedPolicy:
        """The trained agent under its name in tables."""
        return LearnedPolicy(AgentFile.load(self.folder), self.name)


def train_away(candidate: Candidate) -> dict[str, bytes]:
    """Train an agent where its folder need not exist, such as on another machine; the files of its run by name."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "agent"
        dataclasses.replace(candidate, folder=folder).train(quiet=True)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def train_missing(candidates: Sequence[Candidate], out: Path, engine: Engine = ALONE) -> None:
    """Train those that are not there yet.

    Raises:
        AgentFileError: a candidate's folder holds something else.
        InputError: a candidate's folder holds an agent of other settings; nothing has been trained then.
        FileExistsError: ``out``, which holds the folders, is a file.
    """
    waiting = [candidate for candidate in candidates if not candidate.trained]
    kept_folder(out)
    if engine is not ALONE:
        with progress_bar("agents") as bar:
            task = bar.add_task("training", total=len(waiting))
            for index, files in engine.map(train_away, [(candidate,) for candidate in waiting]):
                waiting[index].bring_home(files)
                bar.advance(task)
        return
    for number, candidate in enumerate(waiting, 1):
        console.print(f"training {number}/{len(waiting)}: {candidate.name}", highlight=False)
        candidate.train()
