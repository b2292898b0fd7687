"""The command that soaks."""

from __future__ import annotations

import itertools

from passloc_env.errors import InputError
from training.answer import Unmet
from training.arguments import at_least_one, check_seed, free_path
from training.commands import EVALUATION_SEED, Soak
from training.files import write_whole
from training.progress import console, progress_bar
from training.reliability.flight import fly_leg
from training.reliability.leg import draw
from training.reliability.page import page, summary
from training.reliability.record import Record
from training.reliability.survival import Survival, cases, survivals

_LEG = 200_000
"""Sensor steps of a leg at most, but for its last decision."""


def soak(arguments: Soak) -> Record:
    """Fly legs until they make so many steps, then see what becomes of tracks, and write the page.

    Raises:
        InputError: impossible numbers.
        Unmet: something happened that must not.
    """
    at_least_one(steps=arguments.steps, episodes=arguments.episodes)
    check_seed(arguments.seed)
    if arguments.leg is not None and arguments.leg < 0:
        raise InputError(f"leg = {arguments.leg} is not possible: must be at least 0")
    record = Record(arguments.seed, _command(arguments))
    if arguments.leg is None:
        free_path(arguments.out)
        _fly_all(record, arguments.steps)
        record.survivals = _survive(arguments.episodes)
        write_whole(arguments.out, page(record, arguments.episodes))
        console.print(f"{arguments.out}", highlight=False, soft_wrap=True)
    else:
        _fly_one(record, arguments.leg)
    console.print(summary(record), highlight=False)
    if broken := record.broken():
        raise Unmet("; ".join(broken[:3]), record)
    return record


def _command(arguments: Soak) -> str:
    """What to type for the same again."""
    words = f"passloc soak --steps {arguments.steps} --episodes {arguments.episodes} --seed {arguments.seed}"
    return f"{words} --out {arguments.out.as_posix()}"


def _fly_all(record: Record, steps: int) -> None:
    console.print(f"seed {record.seed}", highlight=False)
    with progress_bar("sensor steps") as bar:
        task = bar.add_task("soaking", total=steps)
        for number in itertools.count():
            bar.update(task, description=f"soaking, leg {number}")
            _fly_one(record, number)
            bar.update(task, completed=min(steps, record.total.steps))
            if record.total.steps >= steps:
                return


def _fly_one(record: Record, number: int) -> None:
    leg = draw(record.seed, number)
    tracker = type(leg.scenario.tracker).__name__

    def tell(what: str) -> None:
        line = f"seed {record.seed}, leg {number} ({leg.scenario.name}, {tracker}): {what}"
        record.faults.append(line)
        console.print(line, highlight=False, soft_wrap=True)

    record.add(leg.scenario.name, fly_leg(leg, _LEG, tell))


def _survive(episodes: int) -> list[Survival]:
    with progress_bar("episodes") as bar:
        task = bar.add_task("losing tracks", total=len(list(cases())) * episodes)
        return survivals(episodes, EVALUATION_SEED, lambda done: bar.update(task, advance=done))
