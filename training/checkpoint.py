"""A training run on disk in the middle of its work: one file of arrays and plain data, whole or not there.

Arrays are kept as safetensors, everything else as JSON in the header of the same file, so that there are no two files
that could be of different ages. A digest over the arrays tells a damaged file from a whole one. The checkpoint before
the last one is kept: whatever happens while one is written, another can be gone on from.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from passloc_env.errors import InputError, one_line
from passloc_env.reading import json_data, read_bytes
from training.files import cannot_write

Taken = TypeVar("Taken")

LATEST, BEFORE = "checkpoint.safetensors", "checkpoint.before.safetensors"
_ABOUT, _DIGEST = "about", "digest"
_KEPT = "__array__"
_SIZE = 8
"""Bytes at the beginning of a safetensors file that say how long its header is."""

LIMIT = 1 << 30
"""Bytes that a checkpoint may take."""

_HEADER_LIMIT, _ITEMS = 1 << 24, 2_000_000
"""Bytes that the header of a checkpoint may take, and values that it may hold: fourteen of them per environment."""


class CheckpointError(InputError):
    """A checkpoint that cannot be used; the message is one line."""


class ForeignCheckpointError(CheckpointError):
    """A checkpoint that may be whole, but is not of this run; the message is one line."""


@dataclass(frozen=True)
class Checkpoint:
    """A tree of mappings and lists whose leaves are arrays, numbers, texts, truth values and None."""

    tree: dict[str, Any]

    def save(self, folder: Path) -> None:
        """Write it as the latest of a run folder, and keep the one that was the latest until now.

        Raises:
            OSError: it cannot be written; those that are there are as they were.
            CheckpointError: it is larger than one may be.
        """
        latest, part = folder / LATEST, folder / f".{LATEST}.part"
        content = self._content()
        if len(content) > LIMIT or _header_size(content) > _HEADER_LIMIT:
            raise CheckpointError(f"{latest} would be larger than can be read again: --checkpoint 0 trains without any")
        try:
            part.unlink(missing_ok=True)
            _write_through(part, content)
            if latest.exists():
                latest.replace(folder / BEFORE)
            part.replace(latest)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise cannot_write(latest, error) from None

    def _content(self) -> bytes:
        from safetensors.numpy import save

        arrays: dict[str, np.ndarray] = {}
        about = json.dumps(_outlined(self.tree, "", arrays))
        return save(arrays, {_ABOUT: about, _DIGEST: _digest(about, arrays)})

    @classmethod
    def load(cls, path: Path) -> Checkpoint:
        """Read and check a checkpoint.

        Raises:
            CheckpointError: there is none, or it is damaged; the message goes on from the path.
        """
        from safetensors import SafetensorError
        from safetensors.numpy import load

        try:
            content = read_bytes(path, LIMIT)
            size = _header_size(content)
            if size > _HEADER_LIMIT:
                raise ValueError("its header is too large for that of a checkpoint")
            metadata = json_data(content[_SIZE : _SIZE + size].decode(), _ITEMS)["__metadata__"]
            arrays = load(content)
            about = metadata[_ABOUT]
            if metadata[_DIGEST] != _digest(about, arrays):
                raise ValueError("its digest is not that of what it holds")
            tree = _restored(json_data(about, _ITEMS), arrays)
            if not isinstance(tree, dict):
                raise ValueError("it holds no mapping")
        except OSError as error:
            raise CheckpointError(f"cannot be read: {error.strerror}") from None
        except (SafetensorError, KeyError, ValueError, TypeError, AttributeError) as error:
            raise CheckpointError(f"is damaged: {one_line(error)}") from None
        return cls(tree)


def has_checkpoint(folder: Path) -> bool:
    """Whether there is something to go on from, whole or damaged."""
    return any((folder / name).exists() for name in (LATEST, BEFORE))


def find_checkpoint(folder: Path, take_up: Callable[[Checkpoint], Taken]) -> tuple[Taken, list[str]]:
    """What comes of the latest usable checkpoint of a run folder, and what is to be said of one that is not.

    Args:
        folder: of the run.
        take_up: makes use of a checkpoint, or refuses it by a CheckpointError whose message goes on from the path.

    Raises:
        CheckpointError: none is usable.
        ForeignCheckpointError: one is of another run.
    """
    said: list[str] = []
    for name in (LATEST, BEFORE):
        path = folder / name
        if not path.exists():
            continue
        try:
            return take_up(Checkpoint.load(path)), said
        except ForeignCheckpointError as error:
            raise ForeignCheckpointError(f"{path} {error}") from None
        except CheckpointError as error:
            said.append(f"{path} {error}")
    raise CheckpointError("; ".join(said))


def forget_checkpoints(folder: Path) -> None:
    """Take the checkpoints of a finished run away."""
    for name in (LATEST, BEFORE):
        (folder / name).unlink(missing_ok=True)


def _write_through(path: Path, content: bytes) -> None:
    """Write a new file and see it onto the disk, so that a name that replaces another never stands for less."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags, 0o666), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _header_size(content: bytes) -> int:
    return int.from_bytes(content[:_SIZE], "little")


def _digest(about: str, arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256(about.encode())
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


def _outlined(tree: Any, name: str, arrays: dict[str, np.ndarray]) -> Any:
    """The tree with a reference in place of each array, which is put among the arrays."""
    if isinstance(tree, dict):
        return {key: _outlined(value, f"{name}/{key}", arrays) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_outlined(value, f"{name}/{index}", arrays) for index, value in enumerate(tree)]
    if isinstance(tree, np.ndarray):
        # Safetensors keep neither order nor strides, and know no scalars of ours.
        arrays[name] = np.ascontiguousarray(tree).reshape(tree.shape)
        return {_KEPT: name}
    return tree.item() if isinstance(tree, np.generic) else tree


def _restored(outline: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(outline, dict):
        if outline.keys() == {_KEPT}:
            return arrays[outline[_KEPT]]
        return {key: _restored(value, arrays) for key, value in outline.items()}
    return [_restored(value, arrays) for value in outline] if isinstance(outline, list) else outline
