"""The folder of a training run: what it was asked for."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from passloc_env.errors import InputError, one_line
from passloc_env.reading import json_data, read_text
from passloc_env.scenario import Scenario
from training.files import json_text, write_whole
from training.hyperparameters import Hyperparameters

CONFIGURATION, CURVE = "config.json", "curve.csv"


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
        data = {
            "scenario": self.scenario.to_dict(),
            "hyperparameters": dataclasses.asdict(self.parameters),
            "seed": self.seed,
            "provenance": self.origin,
        }
        write_whole(folder / CONFIGURATION, json_text(data))

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
