"""Scores of every episode in a folder, so that a run of any length goes on where it stopped.

Each batch is a Parquet file with a row per episode: its seed, the columns of :class:`training.episodes.Scores`, and the
seconds per decision that the policy took in the batch.
"""

from __future__ import annotations

import dataclasses
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from agents import Policy
from passloc_env import __version__
from passloc_env.errors import InputError
from passloc_env.reading import json_data, read_bytes, read_text
from passloc_env.scenario import Scenario
from training.arguments import writable_folder
from training.episodes import Scores, batches
from training.files import json_text, write_whole
from training.lock import LOCK, held
from training.stamp import stamp

BATCH = 1024
"""Episodes per file: however many fly at once, the files are the same."""

_FORMAT = "passloc-results-1"
_SETTINGS = "settings.json"
_SEED, _SECONDS = "seed", "seconds_per_decision"
_PLACE = re.compile(r"\d+-[\w.-]*")
_HALF = re.compile(r"\.(settings|\d{9})\.\d+\.part\.(json|parquet)")
"""Names of policies' folders, and of files that a killed process leaves half-written."""

_FILE_LIMIT = 1 << 24
"""Bytes that a batch may take."""

_TRUTHS = [field.name for field in dataclasses.fields(Scores) if field.type == "BoolArray"]


@dataclasses.dataclass(frozen=True)
class Results:
    """Per-episode scores of several policies on the same episodes.

    Attributes:
        folder: where they lie, a folder for each policy.
        policies: their names in tables.
        episodes: how many each flies.
        seed: of the first.
    """

    folder: Path
    policies: tuple[str, ...]
    episodes: int
    seed: int

    @property
    def batches(self) -> list[tuple[int, int]]:
        """First episode and number of episodes of each file of a policy."""
        return batches(self.episodes, BATCH)

    def path(self, policy: str, first: int) -> Path:
        """The file of a policy's batch."""
        word = re.sub(r"[^\w.-]+", "-", policy.replace("°", "deg")).strip("-")
        return self.folder / f"{self.policies.index(policy)}-{word}" / f"{first:09d}.parquet"

    def keep(self, policy: str, first: int, scores: Scores, seconds: float) -> None:
        """Write a batch; its file appears whole or not at all."""
        import pyarrow
        from pyarrow import parquet

        count, content = len(scores.lost), io.BytesIO()
        seeds = np.arange(self.seed + first, self.seed + first + count)
        table = {_SEED: seeds, **vars(scores), _SECONDS: np.full(count, seconds)}
        parquet.write_table(pyarrow.table(table), content)
        path = self.path(policy, first)
        path.parent.mkdir(exist_ok=True)
        write_whole(path, content.getvalue())

    def scores(self, policy: str) -> Scores:
        """The scores of a policy, each read whenever it is asked for, and held no longer than by whoever asked.

        InputError says then that a file is missing or damaged.
        """
        return _StoredScores(lambda name: self._column(policy, name))

    def seconds(self, policy: str) -> float:
        """Seconds per decision that a policy took.

        Raises:
            InputError: a file is missing or damaged.
        """
        return float(self._column(policy, _SECONDS).mean())

    def _column(self, policy: str, name: str) -> np.ndarray:
        column = np.empty(self.episodes, bool if name in _TRUTHS else float)
        for first, count in self.batches:
            path = self.path(policy, first)
            values = _read(path, name, np.arange(self.seed + first, self.seed + first + count))
            if values is None:
                raise InputError(f"{path} cannot be read: remove it, and run the same command again")
            column[first : first + count] = values
        return column


def _read(path: Path, name: str, seeds: np.ndarray) -> np.ndarray | None:
    """A column of the batch with these seeds; None where the file is missing, damaged or of another batch or kind."""
    import pyarrow
    from pyarrow import parquet

    kinds = {_SEED: pyarrow.int64(), name: pyarrow.bool_() if name in _TRUTHS else pyarrow.float64()}
    try:
        with parquet.ParquetFile(io.BytesIO(read_bytes(path, _FILE_LIMIT))) as file:
            known = all(file.schema_arrow.field(each).type == kind for each, kind in kinds.items())
            if not known or file.metadata.num_rows != len(seeds):
                return None
            table = file.read(columns=list(kinds), use_threads=False)
    except (InputError, OSError, KeyError, ValueError, pyarrow.ArrowException):
        return None
    whole = all(table[each].null_count == 0 for each in kinds) and np.array_equal(table[_SEED].to_numpy(), seeds)
    return table[name].to_numpy() if whole else None


class _StoredScores(Scores):
    """Scores none of which is held."""

    def __init__(self, column: Callable[[str], np.ndarray]) -> None:
        self._column = column

    def __getattr__(self, name: str) -> np.ndarray:
        if name not in Scores.__dataclass_fields__:
            raise AttributeError(f"scores have no {name}")
        return self._column(name)


class ScoresOnDisk(Mapping[str, Scores]):
    """The scores of each policy by its name; see :meth:`Results.scores`."""

    def __init__(self, results: Results) -> None:
        self._results = results

    def __getitem__(self, policy: str) -> Scores:
        if policy not in self._results.policies:
            raise KeyError(policy)
        return self._results.scores(policy)

    def __iter__(self) -> Iterator[str]:
        return iter(self._results.policies)

    def __len__(self) -> int:
        return len(self._results.policies)


@contextmanager
def opened_results(
    folder: Path, scenario: Scenario, names: Sequence[str], policies: Sequence[Policy], episodes: int, seed: int
) -> Iterator[Results]:
    """The results in a folder, begun now or earlier; only one process at a time may add to them.

    Args:
        folder: where they lie or will lie.
        scenario: the problem.
        names: of the policies in tables.
        policies: who decides.
        episodes: how many each policy flies.
        seed: of the first.

    Raises:
        InputError: the folder holds something else or results of other settings, or another process adds to it.
        ModuleNotFoundError: pyarrow is not installed.
        OSError: a folder that cannot be written into.
    """
    import pyarrow  # noqa: F401  (that it is missing is told before anything is flown)

    settings = {
        "format": _FORMAT,
        "version": __version__,
        "scenario": scenario.to_dict(),
        "policies": {name: stamp(policy) for name, policy in zip(names, policies, strict=True)},
        "episodes": episodes,
        "seed": seed,
        "batch": BATCH,
    }
    known = json.loads(json_text(settings))
    _refuse_others(known, folder)
    with held(writable_folder(folder)):
        # Again: somebody may have begun meanwhile.
        _refuse_others(known, folder)
        for path in _left_behind(folder):
            path.unlink(missing_ok=True)
        if not (folder / _SETTINGS).exists():
            write_whole(folder / _SETTINGS, json_text(settings))
        yield Results(folder, tuple(names), episodes, seed)


def _left_behind(folder: Path) -> list[Path]:
    """What killed processes have left half-written of results, and of nothing else, in their folder."""
    places = [folder, *(path for path in folder.iterdir() if _PLACE.fullmatch(path.name) and not path.is_symlink())]
    entries = [path for place in places if place.is_dir() for path in place.iterdir()]
    return [path for path in entries if _HALF.fullmatch(path.name)]


def _refuse_others(settings: dict[str, Any], folder: Path) -> None:
    """InputError unless the folder is new or of the same settings; nothing is changed."""
    path = folder / _SETTINGS
    if not folder.is_dir():
        return
    for entry in folder.iterdir():
        if entry.is_symlink():
            raise InputError(f"{entry} is a link: name another folder with --results")
    if not path.exists():
        known = {LOCK, *(left.name for left in _left_behind(folder))}
        if any(entry.name not in known for entry in folder.iterdir()):
            raise InputError(f"{folder} is not an empty folder: name another one with --results")
        return
    try:
        found = json_data(read_text(path))
        # As text, for the order of the policies counts.
        other = [name for name, value in settings.items() if json_text(found.get(name)) != json_text(value)]
    except (InputError, OSError, AttributeError):
        raise InputError(f"{path} cannot be read: name another folder with --results") from None
    if other:
        raise InputError(f"{folder} holds results of other {', '.join(other)}: name another folder with --results")
