"""What a soak has found, and what it has to be."""

from __future__ import annotations

import ctypes
import dataclasses
import gc
import os
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from passloc_env.compiled.prepare import plan_of
from training.provenance import provenance
from training.reliability.flight import Tally
from training.reliability.survival import Survival

MOST_REPAIRS = 1e-4
"""Repairs per sensor step at most."""

MOST_GROWTH = 4.0
"""MiB per million sensor steps at most."""

LONG = 5_000_000
"""Sensor steps of a soak that growth is looked for in: in shorter ones what is kept for good counts as growth."""


@dataclass
class Record:
    """A soak.

    Attributes:
        seed: from which all legs follow.
        command: what to type to have it again.
        tallies: by scenario.
        faults: one line for everything that must not happen.
        memory: resident memory that every leg has left held, MiB, beside the sensor steps so far.
        survivals: what became of tracks when sensors fail.
    """

    seed: int
    command: str
    tallies: dict[str, Tally] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    memory: list[tuple[int, float]] = field(default_factory=list)
    survivals: list[Survival] = field(default_factory=list)
    origin: dict[str, Any] = field(default_factory=lambda: provenance(sys.argv))

    def add(self, scenario: str, tally: Tally) -> None:
        """Count a leg, and look at the memory that is still held after it."""
        self.tallies.setdefault(scenario, Tally()).add(tally)
        _let_go()
        self.memory.append((self.total.steps, resident()))

    @property
    def total(self) -> Tally:
        """All scenarios together."""
        total = Tally()
        for tally in self.tallies.values():
            total.add(tally)
        return total

    @property
    def growth(self) -> float:
        """MiB per million sensor steps over the second half of a soak, by least squares; NaN in one not ``LONG``."""
        steps, memory = np.array(self.memory, float).reshape(-1, 2).T
        late = steps >= 0.5 * steps[-1] if len(steps) else np.zeros(0, bool)
        if np.count_nonzero(late) < 3 or steps[-1] < LONG:
            return float("nan")
        return float(np.polyfit(1e-6 * steps[late], memory[late], 1)[0])

    @property
    def repair_rate(self) -> float:
        """Repairs per sensor step."""
        return self.total.repairs / max(1, self.total.steps)

    def broken(self) -> list[str]:
        """What is not as it has to be, one line each."""
        lines = list(self.faults)
        if self.repair_rate >= MOST_REPAIRS:
            lines.append(f"{self.repair_rate:.1e} repairs per step, below {MOST_REPAIRS:g} are allowed")
        if self.growth > MOST_GROWTH:
            lines.append(f"memory grows by {self.growth:.1f} MiB per million steps, {MOST_GROWTH:g} are allowed")
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Everything, as data that JSON knows."""
        return {
            "seed": self.seed,
            "command": self.command,
            "scenarios": {name: dataclasses.asdict(tally) for name, tally in self.tallies.items()},
            "faults": self.faults,
            "repairs_per_step": self.repair_rate,
            "growth_mib_per_million_steps": self.growth,
            "memory_mib": self.memory,
            "survivals": [
                {**row._asdict(), "lost": dataclasses.asdict(row.lost), "end_error": dataclasses.asdict(row.end_error)}
                for row in self.survivals
            ],
            "provenance": self.origin,
        }


def _let_go() -> None:
    """Forget the plans of scenarios flown, and hand back what is free: a large leg would look like growth for good."""
    plan_of.cache_clear()
    gc.collect()
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


def resident() -> float:
    """Memory that this process holds, MiB; NaN where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
