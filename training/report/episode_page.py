"""A page that plays one episode; ``passloc replay --html``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from passloc_env.scenario import Scenario
from training.evaluate import unique
from training.provenance import provenance
from training.replay import Recording
from training.report.page import Page, write_report
from training.report.player import played


def write_episode(path: Path, scenario: Scenario, recordings: Sequence[Recording], seed: int) -> None:
    """Write a page that plays the flights of an episode side by side."""
    names = unique([recording.name for recording in recordings])
    origin = provenance(sys.argv)
    page = Page(
        title=f"{scenario.name}, seed {seed}",
        player=played(scenario, dict(zip(names, recordings, strict=True)), seed),
        configuration={"Scenario": scenario.to_yaml(), "Replay": json.dumps(origin, indent=2, ensure_ascii=False)},
        command=origin["command"],
    )
    write_report(page, path)
