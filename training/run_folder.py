"""The folder of a training run: what it was asked for."""

from __future__ import annotations

import dataclasses
import hashlib
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from passloc_env.errors import InputError, one_line
from passloc_env.reading import json_data, read_text
from passloc_env.scenario import Scenario
from training.files import json_text, write_whole
from training.hyperparameters import Hyperparameters

CONFIGURATION, CURVE, EVENTS = "config.json", "curve.csv", "tensorboard"


@dataclass(frozen=True)
class Assignment:
    """What a run is to do.

    Attributes:
        scenario: the problem, with the overrides of the hyperparameters.
        parameters: how to train.
        seed: of everything random.
        origin: command, versions and machine of its beginning.
    """

    scenario: Scenario
    parameters: Hyperparameters
    seed: int
    origin: dict[str, Any]

    def save(self, folder: Path) -> None:
        """Write it into a run folder."""
        write_whole(folder / CONFIGURATION, self._text)

    @property
    def digest(self) -> str:
        """SHA-256 of all that it says, in hexadecimal digits; checkpoints name the assignment by it."""
        return hashlib.sha256(self._text.encode()).hexdigest()

    @property
    def _text(self) -> str:
        return json_text(
            {
                "scenario": self.scenario.to_dict(),
                "hyperparameters": dataclasses.asdict(self.parameters),
                "seed": self.seed,
                "provenance": self.origin,
            }
        )

    @classmethod
    def load(cls, folder: Path) -> Assignment:
        """Read it from a run folder.

        Raises:
            InputError: there is none, or it cannot be read.
        """
        path = folder / CONFIGURATION
        try:
            data = json_data(read_text(path))
            parameters = Hyperparameters.from_dict(data["hyperparameters"])
            return cls(Scenario.from_dict(data["scenario"]), parameters, int(data["seed"]), dict(data["provenance"]))
        except OSError:
            raise InputError(f"{folder} is not the folder of a training: it holds no {CONFIGURATION}") from None
        except (InputError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path} is not the configuration of a training: {one_line(error)}") from None


def check_own_files(folder: Path) -> None:
    """Whether all that a run folder holds lies in it: what is written through a link lies elsewhere.

    Raises:
        InputError: a link, a pipe, or a folder other than that of TensorBoard's events.
    """
    for path in sorted(folder.iterdir()):
        kind = path.lstat().st_mode
        if stat.S_ISDIR(kind) and EVENTS in (path.name, folder.name):
            check_own_files(path)
        elif not stat.S_ISREG(kind):
            raise InputError(f"{path} is not a file of a training: {_kind(kind)}, which is not written into")


def _kind(mode: int) -> str:
    if stat.S_ISLNK(mode):
        return "it is a link"
    return "it is a folder" if stat.S_ISDIR(mode) else "it is a pipe or a device"
