"""What shows what there is, and what happens."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from training.commands.fields import EVALUATION_SEED, Answer, File, Folder, Output, Overrides, ScenarioName


@dataclass(frozen=True)
class List:
    """List the scenarios, and who can fly them.

    Or the policies, and what each can be told.

    Examples:
        passloc list
        passloc list --policies
        passloc list --json -
        passloc list --pages runs/scenarios
        passloc list --policies --pages runs
    """

    policies: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """List the policies with their parameters instead."""
    pages: Folder = None
    """Also write a page and a film of every scenario into this folder; with --policies, the page of all policies. What
    is there is replaced."""
    output: Answer = Output()


@dataclass(frozen=True)
class NewScenario:
    """Write a scenario file to begin with.

    It has every field, and a comment that says what each means.

    Examples:
        passloc new-scenario runs/mine.yaml
        passloc new-scenario runs/mine.yaml --like BearingDoppler
    """

    file: Positional[Path]
    """The file; what is there already is never written over."""
    like: str = "BearingsOnly"
    """Which scenario to begin like: name, Gymnasium id, or path."""
    output: Answer = Output()


@dataclass(frozen=True)
class Observe:
    """Say what can be known along a path.

    Rank, weakest direction and Cramér–Rao bound of one episode, and a map of the bound over emitter positions.

    Examples:
        passloc observe BearingDopplerCase1b
        passloc observe BearingDopplerCase1b --policy circle --out runs/circle.png
        passloc observe runs/mine.yaml --policy zigzag:angle=45 --json runs/observed.json
    """

    scenario: ScenarioName = "BearingsOnly"
    policy: str = "stationary"
    """Who flies the episode: a rule, planner, learned (the shipped agent), agent:NAME, or path of a trained agent."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    out: File = None
    """The picture; by default runs/observe/SCENARIO-POLICY-SEED.png."""
    override: Overrides = ()
    output: Answer = Output()


@dataclass(frozen=True)
class Replay:
    """Watch policies fly the same episode, side by side.

    In a window, unless files are asked for.

    Examples:
        passloc replay BearingsOnly --policy learned,circle,straight --seed 1000003 --gif runs/replay.gif
        passloc replay runs/mine.yaml --policy zigzag:angle=45 --mp4 runs/zigzag.mp4
        passloc replay BearingDopplerCase1b --policy learned,circle --html runs/replay.html
    """

    scenario: ScenarioName = "BearingsOnly"
    policy: str = "circle"
    """Rules, planners, learned (the shipped agent), agent:NAME and paths of trained agents, separated by commas."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    gif: File = None
    """Write moving pictures here."""
    mp4: File = None
    """Write a film here."""
    html: File = None
    """Write a page here that plays the episode; it needs no network."""
    override: Overrides = ()
    output: Answer = Output()


@dataclass(frozen=True)
class Export:
    """Write a flown episode as tables.

    Truth, platforms, detections and tracks, as CSV or Parquet. For Stone Soup's own objects see the module
    training.export.stone_soup.

    Examples:
        passloc export BearingsOnly --out runs/flight
        passloc export BearingsOnly --policy learned --seed 1000003 --format parquet --out runs/flight
        passloc export runs/mine.yaml --override sensors.0.sigma=0.01 --out runs/flight
    """

    scenario: ScenarioName = "BearingsOnly"
    policy: str = "circle"
    """Who flies the episode: a rule, planner, learned (the shipped agent), agent:NAME, or path of a trained agent."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    out: Path = Path("runs/export")
    """Folder of the tables; tables that are there are replaced."""
    format: Literal["csv", "parquet"] = "csv"
    """Kind of file; Parquet needs passloc[export]."""
    override: Overrides = ()
    output: Answer = Output()
