"""What holds the software to its promises."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from training.commands.fields import Answer, Folder, Output, Where, Work


@dataclass(frozen=True)
class Reproduce:
    """Reproduce five papers, claim by claim.

    Simulations, figures, claims.json and a page, each claim with its verdict.

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
    work: Where = Work()
    output: Answer = Output()


@dataclass(frozen=True)
class Bench:
    """Measure the speed, beside FilterPy and Stone Soup.

    What counts are ratios within one run.

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
    out: Folder = None
    """Also write a page with the tables and a figure into this folder."""
    output: Answer = Output()


@dataclass(frozen=True)
class Soak:
    """Fly random scenarios for long: nothing may break.

    Exceptions, numbers that are not finite, indefinite covariances, repairs, growth of memory, and tracks that are lost
    when sensors fail are counted. What must not happen is told with the leg that repeats it, and makes the status 1.

    Examples:
        passloc soak --steps 1000000 --out runs/reliability.md
        passloc soak --seed 3 --leg 17
    """

    steps: int = 10_000_000
    """Sensor steps of all environments together."""
    episodes: int = 1000
    """Episodes that each share of lost tracks is counted on."""
    seed: int = 0
    """Seed of everything random in it."""
    leg: int | None = None
    """Fly this leg alone, and write no page."""
    out: Path = Path("docs/reliability.md")
    """The page; what is there already is replaced."""
    output: Answer = Output()
