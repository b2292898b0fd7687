"""The speed that must not be lost again: ratios against the FilterPy environment, measured in one run."""

from __future__ import annotations

from training.benchmark.report import Stepping

FLOORS = {
    ("passloc, scalar", 1): 7.0,
    ("passloc, vector", 256): 380.0,
    ("passloc, vector", 1024): 430.0,
    ("passloc, vector", 4096): 500.0,
}
"""By candidate and number of environments: some 55 hundredths of what is usual, for machines differ that much."""


def shortfalls(stepping: Stepping) -> list[str]:
    """One line for each candidate whose median ratio, by processor time, is below its floor."""
    lines = []
    for row in stepping.rows:
        floor = FLOORS.get((row.name, row.environments))
        if floor is not None and row.cpu_ratio.median < floor:
            found = f"{row.cpu_ratio.median:.3g} times the FilterPy environment"
            lines.append(f"{row.name}, N = {row.environments}: {found}, must be at least {floor:g}")
    return lines
