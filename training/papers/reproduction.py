"""What reproducing a paper comes to: claims with verdicts, figures, tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from training.engines import ALONE, Engine
from training.statistics import Estimate


class Verdict(StrEnum):
    """How a claim fared."""

    REPRODUCED = "reproduced"
    REPRODUCED_IF = "reproduced-if"
    NOT_REPRODUCIBLE = "not-reproducible"


@dataclass(frozen=True)
class Claim:
    """One claim of a paper beside what was measured."""

    paper: str
    """Short name of the paper."""
    claim: str
    paper_value: float | str
    """What the paper says."""
    measured: float | str
    """What came out here; for a claim that fails, the reason in numbers."""
    interval: tuple[float, float] | None
    """95 % interval of a measured number from runs; None for exact results."""
    assumption: str
    """Under which settings; for ``reproduced-if`` the condition."""
    verdict: Verdict


@dataclass(frozen=True)
class Figure:
    """A picture that was drawn."""

    file: str
    caption: str


@dataclass(frozen=True)
class Table:
    """A table beside the claims: headings and rows of ready text."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass
class Reproduction:
    """The reproduction of one paper while it is being made.

    Args:
        paper: its short name.
        folder: where figures go.
        runs: Monte Carlo runs asked for; None for the paper's own number.
        seed: of the first run; the others count up from it.
        engine: where the runs are flown.
    """

    paper: str
    folder: Path
    runs: int | None = None
    seed: int = 0
    engine: Engine = ALONE
    claims: list[Claim] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    caution: str = ""
    """What a reader of the verdicts should know; empty when there is nothing."""

    def to_dict(self) -> dict[str, Any]:
        """What has been recorded, as plain data."""
        return {
            "paper": self.paper,
            "runs": self.runs,
            "seed": self.seed,
            "caution": self.caution,
            "claims": [dataclasses.asdict(claim) for claim in self.claims],
            "figures": [dataclasses.asdict(figure) for figure in self.figures],
            "tables": [dataclasses.asdict(table) for table in self.tables],
        }

    def runs_or(self, default: int) -> int:
        """The number of runs asked for, or the paper's; fewer than that are cautioned against."""
        if self.runs is None:
            return default
        if self.runs < default:
            self.caution = f"{self.runs} runs: fewer than the {default} that verdicts are meant for"
        return self.runs

    def claim(
        self,
        claim: str,
        paper_value: float | str,
        measured: float | str | Estimate,
        verdict: Verdict,
        assumption: str = "",
        interval: tuple[float, float] | None = None,
    ) -> None:
        """Record a claim; an :class:`Estimate` brings its interval along."""
        if isinstance(measured, Estimate):
            interval, measured = (measured.low, measured.high), measured.value
        self.claims.append(Claim(self.paper, claim, paper_value, measured, interval, assumption, verdict))

    def table(self, title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Record a table."""
        self.tables.append(Table(title, tuple(headings), tuple(tuple(row) for row in rows)))

    @contextmanager
    def figure(
        self, name: str, caption: str, rows: int = 1, columns: int = 1, size: tuple[float, float] = (5.2, 3.8)
    ) -> Iterator[Any]:
        """Axes ``(rows, columns)`` of a figure, a single one when there is only one; saved as ``paper_name.png``.

        ``size`` is that of one pair of axes, in inches.
        """
        sheet, axes = plt.subplots(
            rows, columns, figsize=(columns * size[0], rows * size[1]), layout="constrained", squeeze=False
        )
        try:
            yield axes[0, 0] if rows == columns == 1 else axes
            file = f"{self.paper}_{name}.png"
            sheet.savefig(self.folder / file, dpi=110)
            self.figures.append(Figure(file, caption))
        finally:
            plt.close(sheet)


def holds(truth: bool) -> Verdict:
    """The verdict on a claim that either holds or does not."""
    return Verdict.REPRODUCED if truth else Verdict.NOT_REPRODUCIBLE
