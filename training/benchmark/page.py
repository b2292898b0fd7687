"""The page of results: the tables as they are printed, and how the cost grows with the number of environments."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from rich.console import Console

from training.benchmark.report import Results, Stepping, show

_LINEAR_FROM = 1024
"""Environments from which the cost is expected to grow in proportion."""


def write_page(results: Results, folder: Path) -> None:
    """Write ``README.md`` and ``growth.png``."""
    console = Console(file=io.StringIO(), record=True, width=100, markup=False, emoji=False)
    show(results, console)
    growth = exponent(results.stepping)
    said = "" if growth is None else f" Above N = {_LINEAR_FROM} it grows as N to the power of {growth:.2f}."
    text = (
        f"# Speed\n\nMade by `{results.command}`.\nRatios are taken within a round, in which all candidates work in "
        "turns in one process; figures of another machine differ.\n\n"
        f"```text\n{console.export_text().strip()}\n```\n\n"
        f"![Processor time of a sensor step against the number of environments](growth.png)\n\n"
        f"The cost of one sensor step of all environments together.{said}\n"
    )
    (folder / "README.md").write_text(text, encoding="utf-8")
    _draw(results.stepping, folder / "growth.png")


def costs(stepping: Stepping) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of environments, and processor seconds of a sensor step of all of them."""
    rows = [row for row in stepping.rows if row.name == "passloc, vector"]
    sizes = np.array([row.environments for row in rows], float)
    return sizes, sizes / np.array([row.per_cpu_second.median for row in rows])


def exponent(stepping: Stepping) -> float | None:
    """The power of N by which the cost grows where it should be linear; None with less than two sizes there."""
    sizes, seconds = costs(stepping)
    large = sizes >= _LINEAR_FROM
    if np.count_nonzero(large) < 2:
        return None
    return float(np.polyfit(np.log(sizes[large]), np.log(seconds[large]), 1)[0])


def _draw(stepping: Stepping, path: Path) -> None:
    import matplotlib.pyplot as plt

    sizes, seconds = costs(stepping)
    figure, axes = plt.subplots(figsize=(7.0, 4.4), layout="constrained")
    axes.loglog(sizes, 1e3 * seconds, "o-", label="passloc, vector")
    axes.loglog(sizes, 1e3 * seconds[-1] * sizes / sizes[-1], "--", color="grey", label="in proportion to N")
    axes.loglog(sizes, 1e3 * sizes / stepping.rows[0].per_cpu_second.median, ":", label=stepping.rows[0].name)
    axes.set(xlabel="environments N", ylabel="processor time of a sensor step of all, ms", title=stepping.scenario)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)
