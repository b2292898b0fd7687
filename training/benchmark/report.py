"""What a benchmark found, as plain data, JSON and tables."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import os
import platform
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from training.progress import console

_LIBRARIES = ("passloc", "numpy", "scipy", "filterpy", "gymnasium", "stonesoup", "stable_baselines3", "torch")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Spread:
    """Median over the rounds, with the smallest and largest."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{_short(self.median)} ({_short(self.low)}–{_short(self.high)})"


def spread(values: Sequence[float]) -> Spread:
    """The spread of one value per round."""
    return Spread(statistics.median(values), min(values), max(values))


@dataclass(frozen=True)
class Row:
    """The speed of one candidate.

    Attributes:
        name: what it is.
        environments: how many ran together.
        per_cpu_second: sensor steps per second of processor time.
        per_wall_second: sensor steps per second on the clock.
        cpu_ratio: the former against FilterPy's side in the same round.
        wall_ratio: the latter against it.
        note: what sets it apart from the others of its table; empty when nothing does.
    """

    name: str
    environments: int
    per_cpu_second: Spread
    per_wall_second: Spread
    cpu_ratio: Spread
    wall_ratio: Spread
    note: str


@dataclass(frozen=True)
class Stepping:
    """Sensor steps per second, of the environments or of the trackers alone.

    Attributes:
        scenario: its name.
        rounds: turns of each candidate.
        seconds: wall time of each turn at least, s.
        rows: the candidates, FilterPy's side first.
        notes: how to read them.
    """

    scenario: str
    rounds: int
    seconds: float
    rows: list[Row]
    notes: list[str]


@dataclass(frozen=True)
class Cost:
    """What a scenario costs.

    Attributes:
        name: the scenario's.
        states: of the tracker.
        scalars: of a measurement.
        steps: of an episode.
        microseconds: processor time of a sensor step of one environment.
        kilobytes: kept for each environment, noise of the whole episode included.
    """

    name: str
    states: int
    scalars: int
    steps: int
    microseconds: Spread
    kilobytes: float


@dataclass(frozen=True)
class Growth:
    """How cost grows with what a scenario holds.

    Attributes:
        environments: of each scenario.
        rounds: turns of each.
        costs: the scenarios.
    """

    environments: int
    rounds: int
    costs: list[Cost]


@dataclass(frozen=True)
class Learner:
    """The speed of PPO on one side.

    Attributes:
        name: the environment.
        environments: how many.
        per_second: sensor steps per second on the clock, collecting and updates together.
        collecting: sensor steps per second while collecting.
        updating: seconds per update.
        share: the environment's part of the time.
    """

    name: str
    environments: int
    per_second: Spread
    collecting: Spread
    updating: Spread
    share: Spread


@dataclass(frozen=True)
class Learning:
    """Sensor steps per second while PPO learns.

    Attributes:
        scenario: its name.
        rounds: turns of each side.
        rollout: decisions per rollout.
        batch: decisions per gradient step.
        epochs: passes over a rollout.
        learners: passloc and the FilterPy environment.
        ratio: of the first to the second, per round.
        notes: how to read them.
    """

    scenario: str
    rounds: int
    rollout: int
    batch: int
    epochs: int
    learners: list[Learner]
    ratio: Spread
    notes: list[str]


@dataclass(frozen=True)
class Machine:
    """Where it ran.

    Attributes:
        processor: its name.
        cores: logical cores.
        system: operating system.
        python: version.
        versions: of the libraries; those that are not installed are left out.
        threads: the environment variables that limit threads, where set.
    """

    processor: str
    cores: int
    system: str
    python: str
    versions: dict[str, str]
    threads: dict[str, str]


@dataclass(frozen=True)
class Results:
    """Everything a benchmark found.

    Attributes:
        command: the command line that repeats it.
        date: when, if it was given.
        machine: where.
        stepping: the environments alone.
        states: the same with more states, unless left out.
        workers: several processes, unless left out.
        peers: the FilterPy environment in others' wrappers, unless left out.
        growth: every scenario, unless left out.
        trackers: the trackers alone, unless left out.
        learning: PPO, at settings that are fast and at those that learn best; empty when left out.
    """

    command: str
    date: str | None
    machine: Machine
    stepping: Stepping
    states: Stepping | None = None
    workers: Stepping | None = None
    peers: Stepping | None = None
    growth: Growth | None = None
    trackers: Stepping | None = None
    learning: tuple[Learning, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Every number."""
        return dataclasses.asdict(self)


def this_machine() -> Machine:
    """The machine this process runs on."""
    return Machine(
        processor=_processor(),
        cores=os.cpu_count() or 1,
        system=platform.system(),
        python=platform.python_version(),
        versions={name: version for name in _LIBRARIES if (version := _version(name)) is not None},
        threads={name: os.environ[name] for name in _THREADS if name in os.environ},
    )


def show(results: Results, console: Console = console) -> None:
    """Print the tables."""
    machine = results.machine
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    console.print(f"{machine.processor}, {machine.cores} cores; Python {machine.python}; {versions}", style="dim")
    tables = (results.stepping, results.states, results.workers, results.peers, results.trackers)
    for stepping in filter(None, tables):
        console.print(_stepping_table(stepping))
        remarks = [f"{row.name}: {row.note}." for row in stepping.rows if row.note]
        _print_notes(console, remarks + stepping.notes)
    if results.growth is not None:
        console.print(_growth_table(results.growth))
    for learning in results.learning:
        console.print(_learning_table(learning))
        _print_notes(console, learning.notes)


def _blank_table(title: str, first: str, headings: Sequence[str]) -> Table:
    """A table whose first column holds names, and the others numbers."""
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(first, no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _stepping_table(stepping: Stepping) -> Table:
    title = f"{stepping.scenario}: sensor steps per second, median (min–max) of {stepping.rounds} rounds"
    table = _blank_table(title, "candidate", ("N", "per\nCPU s", "per\nwall s", "× peer,\nCPU", "× peer,\nwall"))
    for row in stepping.rows:
        medians = (row.per_cpu_second.median, row.per_wall_second.median)
        ratios = (str(row.cpu_ratio), _short(row.wall_ratio.median))
        table.add_row(row.name, str(row.environments), *map(_short, medians), *ratios)
    return table


def _growth_table(growth: Growth) -> Table:
    title = f"A sensor step of one environment among {growth.environments}, median (min–max) of {growth.rounds} rounds"
    table = _blank_table(title, "scenario", ("states", "scalars", "steps", "CPU µs", "kB"))
    for cost in growth.costs:
        sizes = map(str, (cost.states, cost.scalars, cost.steps))
        table.add_row(cost.name, *sizes, str(cost.microseconds), _short(cost.kilobytes))
    return table


def _learning_table(learning: Learning) -> Table:
    title = (
        f"{learning.scenario}: sensor steps per second of PPO, median of {learning.rounds} rounds\n"
        f"rollout {learning.rollout}, batch {learning.batch}, {learning.epochs} epochs"
    )
    table = Table(title=title, caption=f"passloc : FilterPy = {learning.ratio}", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("environment", no_wrap=True)
    for heading in ("N", "end to end", "collecting", "s per update", "environment's\nshare"):
        table.add_column(heading, justify="right", no_wrap=True)
    for learner in learning.learners:
        measured = (learner.per_second, learner.collecting, learner.updating, learner.share)
        table.add_row(learner.name, str(learner.environments), *(_short(each.median) for each in measured))
    return table


def _print_notes(console: Console, notes: Sequence[str]) -> None:
    for note in notes:
        console.print(f"• {note}", style="dim")


def _short(value: float) -> str:
    """Three digits that matter, with a k for thousands."""
    if value >= 1000.0:
        return f"{_digits(value / 1000.0)}k"
    return _digits(value)


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _processor() -> str:
    """The processor's name; Linux alone tells more than the architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def _version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None
