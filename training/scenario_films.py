"""A short film of every scenario, flown by the policy that its page names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents import Policy, find_policy
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from training.commands import EVALUATION_SEED
from training.film import write_gif
from training.progress import progress_bar
from training.replay import record, side_by_side
from training.scenario_pages import film_name, pilot

FRAMES = 30
"""Pictures per film, evenly spread over the episode."""

_PER_SECOND = 5.0
_HELD = 6
"""Frames for which the end is shown."""


def write_films(folder: Path) -> list[Path]:
    """Write ``NAME.gif`` for every scenario into an existing folder; what was written."""
    written = []
    with progress_bar("scenarios") as bar:
        task = bar.add_task("filming", total=len(SCENARIOS))
        for scenario in SCENARIOS.values():
            path = folder / film_name(scenario)
            write_film(path, scenario, [find_policy(pilot(scenario), scenario)])
            written.append(path)
            bar.advance(task)
    return written


def write_film(path: Path, scenario: Scenario, policies: Sequence[Policy], seed: int = EVALUATION_SEED) -> None:
    """Write one episode as a GIF of a few pictures, several policies side by side."""
    frames = list(side_by_side([record(scenario, policy, seed) for policy in policies]))
    shown = np.unique(np.linspace(0, len(frames) - 1, FRAMES).round().astype(int))
    write_gif(path, [frames[index] for index in (*shown, *shown[-1:].repeat(_HELD))], _PER_SECOND)
