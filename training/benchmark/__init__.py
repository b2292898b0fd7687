"""passloc bench: how fast the environments step and learn, against a hand-written environment around FilterPy.

Both sides do the same: world, unscented filter, Cramér–Rao bound, reward, observation and resets; a test holds their
rewards and observations together to 1e-6. They run in one process and in turns, and what counts is the ratio within a
round, which a machine's drifting speed leaves alone.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from passloc_env import SCENARIOS

if TYPE_CHECKING:
    from training.benchmark.report import Results

__all__ = ["Bench", "main", "run"]


@dataclass(frozen=True)
class Bench:
    """Measure sensor steps per second; nothing else should run on the machine meanwhile."""

    sizes: tuple[int, ...] = (1, 16, 256, 1024, 4096)
    """Numbers of environments for the vector environment."""

    rounds: int = 7
    """Turns of each candidate."""

    seconds: float = 0.5
    """Length of each turn, s; below 0.2 the ratios get noisy."""

    learning: bool = True
    """Also measure PPO end to end, on both sides."""

    learning_rounds: int = 3
    """Turns of each side in learning."""

    peer_steps: int = 60
    """Decisions that each FilterPy environment collects in a turn of learning; 1024 makes the whole rollout."""

    json: Path | None = None
    """Where to write all numbers as JSON."""

    date: str | None = None
    """A date to put into the results."""

    def __post_init__(self) -> None:
        for name in ("rounds", "learning_rounds", "peer_steps"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} = {getattr(self, name)} is not possible: must be at least 1")
        if self.seconds <= 0.0:
            raise ValueError(f"seconds = {self.seconds} is not possible: must be above 0")
        if any(size < 1 for size in self.sizes):
            raise ValueError(f"sizes = {self.sizes} is not possible: each must be at least 1")

    @property
    def command(self) -> str:
        """The command line that repeats the measurement, without the file it writes and the date."""
        words = ["passloc bench"]
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name in ("json", "date") or value == field.default:
                continue
            if isinstance(value, bool):
                words.append(f"--{'' if value else 'no-'}{field.name}")
            else:
                values = value if isinstance(value, tuple) else (value,)
                words.append(f"--{field.name.replace('_', '-')} {' '.join(map(str, values))}")
        return " ".join(words)


def run(arguments: Bench) -> Results:
    """Measure, and write the JSON file when one is asked for.

    Raises:
        FileNotFoundError: the file's folder does not exist; told before measuring.
    """
    if arguments.json is not None and not arguments.json.absolute().parent.is_dir():
        raise FileNotFoundError(f"there is no folder {arguments.json.absolute().parent}")
    # FilterPy, Stable-Baselines3 and PyTorch take seconds to import: not before they are wanted.
    from training.benchmark.harness import measure_stepping
    from training.benchmark.report import Results, this_machine

    stepping = measure_stepping(SCENARIOS["BearingDoppler"], arguments.sizes, arguments.rounds, arguments.seconds)
    learning = None
    if arguments.learning:
        from training.benchmark.learning import Plan, measure_learning

        plan = Plan(peer_steps=arguments.peer_steps)
        learning = measure_learning(SCENARIOS["BearingsOnly"], arguments.learning_rounds, plan)
    results = Results(arguments.command, arguments.date, this_machine(), stepping, learning)
    if arguments.json is not None:
        arguments.json.write_text(results.to_json(), encoding="utf-8")
    return results


def main(arguments: Bench | None = None) -> Results:
    """Measure and print the tables."""
    from training.benchmark.report import show

    results = run(arguments or Bench())
    show(results)
    return results
