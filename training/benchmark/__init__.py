"""passloc bench: how fast the environments step and learn, against a hand-written environment around FilterPy.

Both sides do the same: world, unscented filter, Cramér–Rao bound, reward, observation and resets; a test holds their
rewards and observations together to 1e-6. A second table has the trackers alone, beside FilterPy's filters. They run in
one process and in turns, and what counts is the ratio within a round, which a machine's drifting speed leaves alone.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from passloc_env import SCENARIOS
from passloc_env.errors import InputError
from training.answer import Unmet
from training.arguments import writable_folder
from training.commands import Bench

if TYPE_CHECKING:
    from training.benchmark.report import Learning, Results

TRACKED = 1024
"""Environments in which the trackers alone, and all scenarios, are measured."""

SHARED = 4096
"""Environments from which several processes are measured."""

__all__ = ["Bench", "command", "measure", "run"]


def run(arguments: Bench, date: str | None = None) -> Results:
    """Measure, print the tables, and write a page when one is asked for.

    Args:
        arguments: what to measure, and how long.
        date: to be put into the results.

    Raises:
        InputError: a number that is not possible.
        OSError: a folder that cannot be written into; told before measuring.
        Unmet: with ``guard``, ratios below their floors, after all is shown and written.
    """
    if arguments.out is not None:
        writable_folder(arguments.out)
    results = measure(arguments, date)

    from training.benchmark.report import show

    show(results)
    if arguments.out is not None:
        from training.benchmark.page import write_page

        write_page(results, arguments.out)
    if arguments.guard:
        from training.benchmark.floors import shortfalls

        missed = shortfalls(results.stepping)
        if missed:
            raise Unmet("\n".join(missed), results)
    return results


def measure(arguments: Bench, date: str | None = None) -> Results:
    """Measure, without a word; arguments and errors as for :func:`run`."""
    _check(arguments)
    # FilterPy, Stable-Baselines3 and PyTorch take seconds to import: not before they are wanted.
    from training.benchmark.growth import VARIANTS, measure_growth
    from training.benchmark.harness import measure_states, measure_stepping, measure_workers
    from training.benchmark.report import Results, this_machine

    stepping = measure_stepping(SCENARIOS["BearingDoppler"], arguments.sizes, arguments.rounds, arguments.seconds)
    steps = (arguments.rounds, arguments.seconds)
    states = workers = peers = growth = trackers = None
    if arguments.states and arguments.sizes:
        states = measure_states(VARIANTS["6 states"], arguments.sizes, *steps)
    if arguments.workers > 1:
        sizes = [size for size in arguments.sizes if size >= SHARED] or [SHARED]
        workers = measure_workers(SCENARIOS["BearingDoppler"], sizes, arguments.workers, *steps)
    if arguments.peers:
        from training.benchmark.peers import measure_peers

        peers = measure_peers(SCENARIOS["BearingDoppler"], *steps)
    if arguments.growth:
        growth = measure_growth(TRACKED, *steps)
    if arguments.trackers:
        from training.benchmark.trackers import measure_trackers

        trackers = measure_trackers(SCENARIOS["BearingDoppler"], TRACKED, *steps)
    learning: tuple[Learning, ...] = ()
    if arguments.learning:
        from training.benchmark.learning import Plan, measure_learning

        taught = SCENARIOS["BearingsOnly"]
        plans = (Plan(), Plan.that_learns_best(taught.name))
        learning = tuple(measure_learning(taught, arguments.rounds, plan) for plan in plans)
    tables = (stepping, states, workers, peers, growth, trackers, learning)
    return Results(command(arguments), date, this_machine(), *tables)


def command(arguments: Bench) -> str:
    """The command line that repeats the measurement, without the file it writes."""
    words = ["passloc bench"]
    for field in dataclasses.fields(arguments):
        value = getattr(arguments, field.name)
        if field.name in ("output", "out", "guard") or value == field.default:
            continue
        if isinstance(value, bool):
            words.append(f"--{'' if value else 'no-'}{field.name}")
        else:
            values = value if isinstance(value, tuple) else (value,)
            words.append(f"--{field.name} {' '.join(map(str, values))}")
    return " ".join(words)


def _check(arguments: Bench) -> None:
    if arguments.rounds < 1:
        raise InputError(f"rounds = {arguments.rounds} is not possible: must be at least 1")
    if not arguments.seconds > 0.0:
        raise InputError(f"seconds = {arguments.seconds} is not possible: must be above 0")
    if any(size < 1 for size in arguments.sizes):
        raise InputError(f"sizes = {arguments.sizes} is not possible: each must be at least 1")
