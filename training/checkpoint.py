"""A training run on disk in the middle of its work: one file of arrays and plain data, whole or not there.

Arrays are kept as safetensors, everything else as JSON in the header of the same file, so that there are no two files
that could be of different ages. A digest over the arrays tells a damaged file from a whole one. The checkpoint before
the last one is kept: whatever happens while one is written, another can be gone on from.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passloc_env.errors import InputError, one_line

LATEST, BEFORE = "checkpoint.safetensors", "checkpoint.before.safetensors"
_ABOUT, _DIGEST = "about", "digest"
_KEPT = "__array__"


class CheckpointError(InputError):
    """A checkpoint that cannot be used; the message is one line."""


@dataclass(frozen=True)
class Checkpoint:
    """A tree of mappings and lists whose leaves are arrays, numbers, texts, truth values and None."""

    tree: dict[str, Any]

    def save(self, folder: Path) -> None:
        """Write it as the latest of a run folder, and keep the one that was the latest until now.

        Raises:
            OSError: it cannot be written; those that are there are as they were.
        """
        latest, part = folder / LATEST, folder / f".{LATEST}.part"
        try:
            _write_through(part, self._content())
            if latest.exists():
                latest.replace(folder / BEFORE)
            part.replace(latest)
        except OSError as error:
            part.unlink(missing_ok=True)
            advice = f"what was saved before is whole: passloc train --resume {folder}"
            raise type(error)(f"{latest} cannot be written: {error.strerror}; {advice}") from None

    def _content(self) -> bytes:
        from safetensors.numpy import save

        arrays: dict[str, np.ndarray] = {}
        about = json.dumps(_outlined(self.tree, "", arrays))
        return save(arrays, {_ABOUT: about, _DIGEST: _digest(about, arrays)})

    @classmethod
    def load(cls, path: Path) -> Checkpoint:
        """Read and check a checkpoint.

        Raises:
            CheckpointError: there is none, or it is damaged.
        """
        from safetensors import SafetensorError, safe_open

        try:
            with safe_open(path, framework="numpy") as file:
                metadata = file.metadata() or {}
                arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
            about = metadata[_ABOUT]
            if metadata[_DIGEST] != _digest(about, arrays):
                raise ValueError("its digest is not that of what it holds")
            tree = _restored(json.loads(about), arrays)
        except OSError as error:
            raise CheckpointError(f"{path} cannot be read: {error.strerror or 'it is not there'}") from None
        except (SafetensorError, KeyError, ValueError, TypeError, RecursionError) as error:
            raise CheckpointError(f"{path} is damaged: {one_line(error)}") from None
        return cls(tree)


def has_checkpoint(folder: Path) -> bool:
    """Whether there is something to go on from, whole or damaged."""
    return any((folder / name).exists() for name in (LATEST, BEFORE))


def find_checkpoint(folder: Path) -> tuple[Checkpoint, list[str]]:
    """The latest whole checkpoint of a run folder, and what is to be said of a damaged one.

    Raises:
        CheckpointError: none is whole.
    """
    said: list[str] = []
    for name in (LATEST, BEFORE):
        if (folder / name).exists():
            try:
                return Checkpoint.load(folder / name), said
            except CheckpointError as error:
                said.append(str(error))
    raise CheckpointError("; ".join(said))


def forget_checkpoints(folder: Path) -> None:
    """Take the checkpoints of a finished run away."""
    for name in (LATEST, BEFORE):
        (folder / name).unlink(missing_ok=True)


def _write_through(path: Path, content: bytes) -> None:
    """Write a file and see it onto the disk, so that a name that replaces another never stands for less."""
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


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
