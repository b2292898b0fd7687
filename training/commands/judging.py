"""What judges policies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from training.commands.fields import EVALUATION_SEED, Answer, Folder, Output, Overrides, ScenarioName, Where, Work


@dataclass(frozen=True)
class Evaluate:
    """Judge policies on the same unseen episodes.

    A table with 95 % intervals, lost tracks and violations counted.

    Examples:
        passloc evaluate BearingsOnly
        passloc evaluate BearingsOnly --policies circle,zigzag:angle=45:leg=80,runs/BearingsOnly-0 --episodes 1024
        passloc evaluate runs/mine.yaml --json runs/evaluation.json
        passloc evaluate BearingsOnly --episodes 100000 --policies circle,learned --workers 2 --results runs/episodes
    """

    scenario: ScenarioName = "BearingsOnly"
    policies: str = ""
    """Rules, planners, learned, agent:NAME and paths of trained agents, separated by commas; by default every rule. The
    first is the reference."""
    episodes: int = 512
    """Episodes per policy."""
    seed: int = EVALUATION_SEED
    """Seed of the first episode; the others count up from it."""
    results: Folder = None
    """Also keep every episode's scores in this folder, as Parquet files; goes on where it stopped."""
    override: Overrides = ()
    work: Where = Work()
    output: Answer = Output()


@dataclass(frozen=True)
class Leaderboard:
    """Judge all policies on all scenarios; goes on where it stopped.

    Tables, pictures, one page.

    Examples:
        passloc leaderboard
        passloc leaderboard --scenarios BearingsOnly,CrossFix --episodes 200 --out runs/board
    """

    scenarios: str = ""
    """Scenarios separated by commas; by default all."""
    policies: str = ""
    """Policies separated by commas, the first is the reference; by default rules, planners, shipped agents and the
    trajectory optimum, which is called optimum here."""
    episodes: int = 1000
    """Episodes per policy."""
    seed: int = EVALUATION_SEED
    """Seed of the first episode; the others count up from it."""
    out: Path = Path("docs/leaderboard")
    """Folder of the page and its pictures; a page that is there is replaced."""
    cache: Path = Path("runs/leaderboard")
    """Folder of the results per episode; what is there and was flown in the same way is not flown again."""
    fresh: bool = False
    """Fly everything again, also what is there: after a change of the code."""
    work: Where = Work()
    output: Answer = Output()


@dataclass(frozen=True)
class Card:
    """Write an agent's scores into its card.

    It is judged on unseen episodes, and shipped with the package if it is given a name.

    Examples:
        passloc card runs/BearingsOnly-0
        passloc card runs/BearingsOnly-0 --scenarios BearingsOnly,BearingsOnlyFar --name BearingsOnly
    """

    run: Positional[Path]
    """Run folder or agent file; its card is replaced."""
    scenarios: str = ""
    """Scenarios that it is for, separated by commas; by default the one it was trained on."""
    episodes: int = 1000
    """Episodes per scenario."""
    seed: int = EVALUATION_SEED
    """Seed of the first episode; the others count up from it."""
    name: str = ""
    """Also put it among the shipped agents, by this name."""
    override: Overrides = ()
    output: Answer = Output()


@dataclass(frozen=True)
class Report:
    """Make one page of a run or an evaluation.

    Table with intervals, learning curve, an episode to play, error against bound, configuration. One file that needs no
    network.

    Examples:
        passloc report runs/mine --out runs/report.html
        passloc report runs/evaluation.json --out runs/evaluation.html
    """

    source: Annotated[Positional[Path], tyro.conf.arg(metavar="RUN|EVALUATION")]
    """Run folder of a training, or file that passloc evaluate --json has written."""
    out: Path = Path("report.html")
    """The page; what is there already is replaced."""
    episodes: int = 512
    """Episodes per policy where a run has not been judged yet."""
    output: Answer = Output()
