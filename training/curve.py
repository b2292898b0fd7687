"""The learning curve: one row per rollout, written as it grows."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from passloc_env.arrays import Array
from passloc_env.errors import InputError, one_line
from passloc_env.reading import read_bytes
from training.files import cannot_write, write_whole

COLUMNS = ("decisions", "seconds", "mean_return", "mean_length", "violations")

CURVE_LIMIT = 1 << 24
"""Bytes that a learning curve may take: three hundred thousand rollouts."""


class CurveCallback(BaseCallback):
    """Keeps and writes wall time, decisions, return, length and violation rate of the episodes of each rollout.

    Args:
        path: the CSV file.
        watch: called with each row; what it raises ends the training.
        rows: those of a training that goes on.
        elapsed: seconds that it has taken already.

    Attributes:
        rows: one dictionary per rollout, keys :data:`COLUMNS`.
    """

    def __init__(
        self,
        path: Path,
        watch: Callable[[dict[str, float]], None] = lambda row: None,
        rows: Sequence[dict[str, float]] = (),
        elapsed: float = 0.0,
    ) -> None:
        super().__init__()
        self.rows = list(rows)
        self._path, self._watch, self._elapsed = path, watch, elapsed
        self._begun: float | None = None
        self._episodes: list[tuple[float, float, bool]] = []

    def _on_training_start(self) -> None:
        self._begun = time.perf_counter() - self._elapsed
        # What was written after the checkpoint that is gone on from will be written again.
        kept = io.StringIO()
        csv.writer(kept).writerows([COLUMNS, *(row.values() for row in self.rows)])
        write_whole(self._path, kept.getvalue())

    @property
    def seconds(self) -> float:
        """How long the training has taken, what came before it went on included."""
        return self._elapsed if self._begun is None else time.perf_counter() - self._begun

    def _on_step(self) -> bool:
        for index in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][index]
            self._episodes.append((info["episode"]["r"], info["episode"]["l"], bool(info["violated"])))
        return True

    def _on_rollout_end(self) -> None:
        if not self._episodes:
            return
        returns, lengths, violated = (np.asarray(column, float) for column in zip(*self._episodes, strict=True))
        self._episodes.clear()
        values = (
            self.num_timesteps,
            self.seconds,
            returns.mean(),
            lengths.mean(),
            violated.mean(),
        )
        row = {name: round(float(value), 6) for name, value in zip(COLUMNS, values, strict=True)}
        self.rows.append(row)
        self.logger.record("rollout/violations", row["violations"])
        try:
            with self._path.open("a", newline="") as file:
                csv.writer(file).writerow(row.values())
        except OSError as error:
            raise cannot_write(self._path, error) from None
        self._watch(row)


def read_curve(path: Path) -> dict[str, Array]:
    """A curve that was kept: values by column, one per rollout.

    Raises:
        InputError: it is not there, it is none, or it is larger than :data:`CURVE_LIMIT`.
    """
    try:
        header, *rows = csv.reader(read_bytes(path, CURVE_LIMIT).decode().splitlines())
        values = np.array(rows, float).reshape(len(rows), len(COLUMNS))
    except OSError as error:
        raise InputError(f"{path} is not a learning curve: {error.strerror}") from None
    except (ValueError, csv.Error):
        raise InputError(f"{path} is not a learning curve") from None
    if tuple(header) != COLUMNS:
        raise InputError(f"{path} is not a learning curve: its columns are {one_line(', '.join(header))}")
    return dict(zip(COLUMNS, values.T, strict=True))
