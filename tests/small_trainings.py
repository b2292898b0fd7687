"""Trainings that take a moment, and what is the same of two of them."""

import csv
import dataclasses
import json
from pathlib import Path

from passloc_env import SCENARIOS
from training.hyperparameters import Hyperparameters

SHORT = SCENARIOS["BearingsOnly"].override({"episode.steps": 40})
TINY = Hyperparameters(decisions=1920, environments=8, rollout=16, batch_size=64, epochs=1, network=(8,), mirror=True)

EVERY = 128
"""Decisions between their checkpoints: those of a rollout."""

SWEPT = dataclasses.replace(TINY, overrides={"episode.steps": 40})
"""The same on the scenario as it is shipped."""


class Stopped(Exception):
    """The process would be gone."""


def without_clock(folder: Path) -> tuple[bytes, list[list[str]], dict]:
    """Weights, curve and card of a run, wall times left out."""
    with (folder / "curve.csv").open(newline="") as file:
        curve = [[cell for column, cell in enumerate(row) if column != 1] for row in csv.reader(file)]
    card = json.loads((folder / "agent.json").read_text(encoding="utf-8"))
    for name in ("seconds", "command"):
        del card["training"][name]
    return (folder / "agent.safetensors").read_bytes(), curve, card
