"""What the command line takes: one documented dataclass per subcommand. Light to import, so that help is quick."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

EVALUATION_SEED = 1_000_000
"""First evaluation seed; training seeds are at least 2⁶² (see ``passloc_env.sb3``)."""


@dataclass(frozen=True)
class List:
    """List the scenarios and the rules.

    Examples:
        passloc list
        passloc list --pages docs/scenarios
    """

    pages: Path | None = None
    """Also write a page and a film of every scenario into this folder; what is there is replaced."""


@dataclass(frozen=True)
class Train:
    """Train an agent and write a run folder: configuration, learning curve, TensorBoard, agent.

    Examples:
        passloc train BearingsOnly
        passloc train BearingsOnly --decisions 500000 --seed 3 --out runs/quick
        passloc train BearingsOnly --override sensors.0.sigma=0.01 episode.decision_every=8
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    out: Path | None = None
    """Run folder; by default runs/SCENARIO-SEED, numbered when that exists."""
    seed: int = 0
    """Seed of everything random in this run."""
    decisions: int | None = None
    """Decisions to train for; by default as the hyperparameters say."""
    hyperparameters: Path | None = None
    """YAML file of hyperparameters; by default the one shipped for the scenario or for its kind."""
    override: tuple[str, ...] = ()
    """Scenario fields to change, as dotted.name=value."""
    quiet: bool = False
    """No progress bar."""


@dataclass(frozen=True)
class Evaluate:
    """Judge policies on the same unseen episodes and print a table with 95 % intervals.

    Examples:
        passloc evaluate BearingsOnly
        passloc evaluate BearingsOnly --policies circle,zigzag:angle=45:leg=80,runs/BearingsOnly-0 --episodes 1024
        passloc evaluate my_scenario.yaml --json results.json
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    policies: str = ""
    """Rules and paths of trained agents, separated by commas; by default every rule. The first is the reference."""
    episodes: int = 512
    """Episodes per policy."""
    seed: int = EVALUATION_SEED
    """Seed of the first episode; the others count up from it."""
    json: Path | None = None
    """Also write the results here."""
    override: tuple[str, ...] = ()
    """Scenario fields to change, as dotted.name=value."""


@dataclass(frozen=True)
class Observe:
    """Say what a path lets one know: rank, weakest direction, Cramér–Rao bound; draw a map of the bound.

    Examples:
        passloc observe BearingDopplerCase1b
        passloc observe BearingDopplerCase1b --policy circle --out circle.png
        passloc observe my_scenario.yaml --policy zigzag:angle=45 --json results.json
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    policy: str = "stationary"
    """Rule or path of a trained agent that flies the episode."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    out: Path | None = None
    """The picture; by default runs/observe/SCENARIO-POLICY-SEED.png."""
    json: Path | None = None
    """Also write the results here."""
    override: tuple[str, ...] = ()
    """Scenario fields to change, as dotted.name=value."""


@dataclass(frozen=True)
class NewScenario:
    """Write a scenario file to begin with: every field, with a comment that says what it means.

    Examples:
        passloc new-scenario runs/mine.yaml
        passloc new-scenario runs/mine.yaml --like BearingDoppler
    """

    file: Positional[Path]
    """The file; what is there already is never written over."""
    like: str = "BearingsOnly"
    """Which scenario to begin like: name, Gymnasium id, or path."""


@dataclass(frozen=True)
class Replay:
    """Watch policies fly the same episode, side by side: in a window, or into a file.

    Examples:
        passloc replay BearingsOnly
        passloc replay BearingsOnly --policy learned,circle,straight --seed 1000003 --gif runs/replay.gif
        passloc replay my_scenario.yaml --policy zigzag:angle=45 --mp4 zigzag.mp4
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    policy: str = "circle"
    """Rules and paths of trained agents, separated by commas."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    gif: Path | None = None
    """Write the pictures here."""
    mp4: Path | None = None
    """Or here."""
    override: tuple[str, ...] = ()
    """Scenario fields to change, as dotted.name=value."""


@dataclass(frozen=True)
class Reproduce:
    """Reproduce papers claim by claim: simulations, figures, claims.json and a page, each claim with its verdict.

    Papers: bearing-doppler (000), dual-satellite (001), radial-acceleration (002), dual-array (003), cross-fix (004).

    Examples:
        passloc reproduce cross-fix --out runs/cross-fix
        passloc reproduce all --out docs/papers
    """

    paper: Positional[str] = "all"
    """Which paper, by name or number, or all."""
    out: Path = Path("runs/reproduce")
    """Folder for figures, claims.json and the page; what is there of the same papers is replaced."""
    runs: int | None = None
    """Monte Carlo runs; by default as many as the paper."""
    seed: int = 0
    """Seed of the first run; the others count up from it."""


@dataclass(frozen=True)
class Demo:
    """Train an agent on BearingsOnly, judge it against the rules on unseen seeds, save table and pictures.

    Examples:
        passloc demo
        passloc demo --decisions 300000 --out runs/quick
    """

    out: Path | None = None
    """Where everything goes; by default runs/demo, numbered when that exists."""
    decisions: int = 2_000_000
    """Decisions to train for; a minute or two, a fifth of what the shipped agent got."""
    episodes: int = 1024
    """Unseen episodes per policy."""
    seed: int = 0
    """Seed of the training run."""


@dataclass(frozen=True)
class Tune:
    """Search hyperparameters; trials are kept in an SQLite file, and the search goes on from them.

    Examples:
        passloc tune BearingsOnly --trials 20
        passloc train BearingsOnly --hyperparameters runs/tune/BearingsOnly/best.yaml
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    trials: int = 20
    """How many more trials."""
    decisions: int = 500_000
    """Decisions that each trial trains for."""
    episodes: int = 512
    """Episodes that each trial is judged by, on seeds of their own."""
    seed: int = 0
    """Seed of the search and of the training runs."""
    out: Path | None = None
    """Folder of study.db and best.yaml; by default runs/tune/SCENARIO."""
    override: tuple[str, ...] = ()
    """Scenario fields to change, as dotted.name=value."""


@dataclass(frozen=True)
class Ablate:
    """Train with one reward after another, with and without a keep-out, and say which reward leads where.

    Examples:
        passloc ablate
        passloc ablate --decisions 300000 --out runs/rewards
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name or Gymnasium id of the scenario."""
    decisions: int = 1_000_000
    """Decisions that each agent trains for."""
    episodes: int = 1024
    """Unseen episodes that each agent is judged by."""
    seed: int = 0
    """Seed of the training runs."""
    out: Path = Path("runs/ablation")
    """Folder of the agents, the table and its page; agents that are there are not trained again."""


@dataclass(frozen=True)
class Seeds:
    """Train the same agent from several seeds: how far chance decides what it learns, and its learning curves.

    Examples:
        passloc seeds BearingsOnly
        passloc seeds BearingsOnlyFar --seeds 0 1 2 3 4 --decisions 1000000
    """

    scenario: Positional[str] = "BearingsOnly"
    """Name, Gymnasium id, or path of a scenario file (YAML or JSON)."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds of the training runs."""
    decisions: int | None = None
    """Decisions that each agent trains for; by default as the hyperparameters say."""
    episodes: int = 1000
    """Unseen episodes that each agent is judged by."""
    out: Path = Path("runs/seeds")
    """Folder of the agents, the page and its picture; agents that are there are not trained again."""


@dataclass(frozen=True)
class Leaderboard:
    """All scenarios × all policies on the same unseen episodes: tables, pictures, one page; goes on where it stopped.

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


@dataclass(frozen=True)
class Card:
    """Judge an agent on unseen episodes, write the scores into its card, and ship it with the package.

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
    override: tuple[str, ...] = ()
    """Fields of the scenarios to change, as dotted.name=value: the tracker that the agent was trained with."""


@dataclass(frozen=True)
class Bench:
    """Measure the speed beside a per-environment FilterPy environment and Stone Soup, as ratios.

    Examples:
        passloc bench
        passloc bench --no-learning --json bench.json
    """

    sizes: tuple[int, ...] = (1, 16, 256, 1024, 4096)
    """Batch sizes."""
    rounds: int = 5
    """Interleaved rounds; the medians count."""
    seconds: float = 0.3
    """Seconds per candidate and round."""
    states: bool = True
    """Also with six states."""
    workers: int = 2
    """Also on so many processes, where N is large; 1 for not."""
    peers: bool = True
    """Also the FilterPy environment in Gymnasium's and Stable-Baselines3's wrappers."""
    growth: bool = True
    """Also every scenario, and more states, sensors and steps."""
    trackers: bool = True
    """Also the trackers alone, each beside FilterPy's filters."""
    learning: bool = True
    """Also PPO end to end."""
    guard: bool = False
    """Fail when a ratio is below the floor that it must keep."""
    out: Path | None = None
    """Also write a page with the tables and a figure into this folder."""
    json: Path | None = None
    """Also write the results here."""
