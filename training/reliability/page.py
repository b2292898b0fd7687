"""The page on what the environment withstands."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from passloc_env.metrics import LOST_ERROR, LOST_NEES
from training.commands import EVALUATION_SEED
from training.markdown import RIGHT, markdown
from training.reliability.flight import Tally
from training.reliability.record import MOST_GROWTH, MOST_REPAIRS, Record
from training.reliability.survival import FAULTS, TRACKED, Survival
from training.table import with_interval


def page(record: Record, episodes: int) -> str:
    """The page as Markdown, given how many episodes each row of lost tracks stands for."""
    found = *_soak(record), *_faults(record), *_survival(record.survivals, episodes)
    return "\n\n".join(("# Reliability", *found, *_origin(record))) + "\n"


def summary(record: Record) -> str:
    """The soak in one line."""
    total, growth = record.total, record.growth
    memory = "is not measured" if math.isnan(growth) else f"grows by {growth:.2f} MiB per million steps"
    return (
        f"{total.steps:,} sensor steps in {total.legs} legs: {total.exceptions} exceptions, {total.nonfinite} numbers "
        f"that are not finite, {total.indefinite} indefinite covariances, {record.repair_rate:.1g} repairs per step, "
        f"memory {memory}"
    )


def _soak(record: Record) -> tuple[str, ...]:
    rows = [(name, *_cells(tally)) for name, tally in record.tallies.items()]
    rows.append(("**all**", *_cells(record.total)))
    columns = ("scenario", "legs", "sensor steps", "exceptions", "not finite", "indefinite", "repairs", "gated")
    return (
        "## The soak",
        "Every scenario, in legs that chance makes: its numbers up to ten times as large or as small, another tracker, "
        "gated or not, sensors that miss, err widely, come late or fall silent, batches of 1 to 4096, actions random "
        "or extreme. Warnings count as exceptions, and every covariance is judged by its eigenvalues at every "
        "decision.",
        f"**{summary(record)}.** Fewer than {MOST_REPAIRS:g} repairs per step are promised, and at most "
        f"{MOST_GROWTH:g} MiB of growth: of what is still held between legs, by least squares over the second half of "
        "the steps, without the compiled steps of past scenarios, of which a process keeps 64. A repair makes a "
        "covariance that rounding has spoilt positive definite again, or begins a track anew.",
        markdown(columns, rows, RIGHT),
    )


def _cells(tally: Tally) -> tuple[str, ...]:
    return tuple(f"{count:,}" for count in vars(tally).values())


def _faults(record: Record) -> tuple[str, ...]:
    broken = record.broken()
    return ("What broke:", "\n".join(f"- {line}" for line in broken)) if broken else ()


def _survival(rows: Sequence[Survival], episodes: int) -> tuple[str, ...]:
    tables = [
        text
        for title in (each.title for each in TRACKED)
        for text in (f"### {title}", _lost(row for row in rows if row.tracked == title))
    ]
    return (
        "## Tracks kept although sensors fail",
        f"{episodes} episodes each, seeds from {EVALUATION_SEED}, the same for every row. A track is lost "
        f"that ends with a relative range error above {LOST_ERROR:g} or a NEES above {LOST_NEES:g}. A gate is given as "
        "the chance that a measurement of the emitter passes it. Trackers are told of no fault. Intervals are 95 %, "
        "Wilson's for lost tracks.",
        *tables,
        "As overrides of every sensor: "
        + "; ".join(f"*{words}*: `{changes}`" for words, changes in FAULTS.items() if changes)
        + ".",
    )


def _lost(rows: Iterable[Survival]) -> str:
    """What became of the tracks of one scenario."""
    cells = [
        (
            row.faults,
            row.policy,
            f"{row.gate:g}" if row.gate else "off",
            with_interval(row.lost, 1, 100.0),
            with_interval(row.end_error, 2, 100.0),
        )
        for row in rows
    ]
    return markdown(("what goes wrong", "policy", "gate", "lost, %", "median end error, %"), cells, RIGHT)


def _origin(record: Record) -> tuple[str, ...]:
    versions = ", ".join(f"{name} {version}" for name, version in record.origin["versions"].items() if version)
    machine = record.origin["machine"]
    return (
        "## Again",
        f"```sh\n{record.command}\n```",
        "A leg follows from the seed and its number alone: `--leg` flies a single one.",
        f"{machine['processor']}, {machine['cores']} cores, {machine['system']}; {versions}.",
    )
