"""What makes agents."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from training.commands.fields import Answer, File, Folder, Output, Overrides, ScenarioName, Where, Work


@dataclass(frozen=True)
class Train:
    """Train an agent.

    The run folder gets the configuration, the learning curve, TensorBoard's events and the agent.

    Examples:
        passloc train BearingsOnly
        passloc train BearingsOnly --decisions 500000 --seed 3 --out runs/quick
        passloc train --resume runs/cut-short
        passloc train BearingsOnly --override sensors.0.sigma=0.01 episode.decision_every=8
    """

    scenario: ScenarioName = "BearingsOnly"
    out: Folder = None
    """Run folder; by default runs/SCENARIO-SEED, numbered when that exists."""
    seed: int = 0
    """Seed of everything random in this run."""
    decisions: int | None = None
    """Decisions to train for; by default as the hyperparameters say."""
    hyperparameters: File = None
    """YAML file of hyperparameters; by default the one shipped for the scenario or for its kind."""
    checkpoint: int = 100_000
    """Decisions between checkpoints; 0 for none."""
    resume: Folder = None
    """Run folder of a training that was cut short, to be gone on with; it knows everything else."""
    override: Overrides = ()
    output: Answer = Output()


@dataclass(frozen=True)
class Convert:
    """Make an agent of a Stable-Baselines3 model.

    It decides as the model's predict(deterministic=True) does. Of the model's file the weights alone are read; nothing
    in it is run, so that it may come from anybody. What VecNormalize has learnt is not in it, and must be folded into
    the first layer before.

    Examples:
        passloc convert models/ppo.zip --scenario BearingsOnly --out runs/converted
    """

    model: Annotated[Positional[Path], tyro.conf.arg(metavar="MODEL")]
    """What model.save of PPO or A2C has written."""
    scenario: str = "BearingsOnly"
    """What it was trained on: name, Gymnasium id, or path of a scenario file."""
    out: Folder = None
    """Folder of the agent; by default runs/SCENARIO-converted, numbered when that exists."""
    override: Overrides = ()
    output: Answer = Output()


@dataclass(frozen=True)
class Demo:
    """Train for a minute, judge on unseen episodes, report.

    An agent for BearingsOnly against the rules: table, pictures and a report to open in a browser.

    Examples:
        passloc demo
        passloc demo --decisions 300000 --out runs/short
    """

    out: Folder = None
    """Where everything goes; by default runs/demo, numbered when that exists."""
    decisions: int = 2_000_000
    """Decisions to train for; a minute or two, a fifth of what the shipped agent got."""
    episodes: int = 1024
    """Unseen episodes per policy."""
    seed: int = 0
    """Seed of the training run."""
    output: Answer = Output()


@dataclass(frozen=True)
class Tune:
    """Search hyperparameters; goes on where it stopped.

    Trials are kept in an SQLite file. Several workers try as many at once, and know of the same earlier ones: another
    number of workers makes another search.

    Examples:
        passloc tune BearingsOnly --trials 20
        passloc train BearingsOnly --hyperparameters runs/tune/BearingsOnly/best.yaml
    """

    scenario: ScenarioName = "BearingsOnly"
    trials: int = 20
    """How many more trials."""
    decisions: int = 500_000
    """Decisions that each trial trains for."""
    episodes: int = 512
    """Episodes that each trial is judged by, on seeds of their own."""
    seed: int = 0
    """Seed of the search and of the training runs."""
    out: Folder = None
    """Folder of study.db and best.yaml; by default runs/tune/SCENARIO."""
    override: Overrides = ()
    work: Where = Work()
    output: Answer = Output()


@dataclass(frozen=True)
class Seeds:
    """Train from several seeds: how far chance decides.

    A page with the learning curves and the scores.

    Examples:
        passloc seeds BearingsOnly
        passloc seeds BearingsOnlyFar --seeds 0 1 2 3 4 --decisions 1000000
    """

    scenario: ScenarioName = "BearingsOnly"
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds of the training runs."""
    decisions: int | None = None
    """Decisions that each agent trains for; by default as the hyperparameters say."""
    episodes: int = 1000
    """Unseen episodes that each agent is judged by."""
    out: Path = Path("runs/seeds")
    """Folder of agents, page and picture; what is there is not trained again, what was cut short goes on."""
    work: Where = Work()
    output: Answer = Output()


@dataclass(frozen=True)
class Ablate:
    """Train with one reward after another: which leads where.

    With and without a keep-out.

    Examples:
        passloc ablate
        passloc ablate --decisions 300000 --out runs/rewards
    """

    scenario: ScenarioName = "BearingsOnly"
    decisions: int = 1_000_000
    """Decisions that each agent trains for."""
    episodes: int = 1024
    """Unseen episodes that each agent is judged by."""
    seed: int = 0
    """Seed of the training runs."""
    out: Path = Path("runs/ablation")
    """Folder of agents, table and page; what is there is not trained again, what was cut short goes on."""
    output: Answer = Output()
