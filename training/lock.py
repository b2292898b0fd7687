"""That two processes do not write into one folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import filelock

from passloc_env.errors import InputError

LOCK = ".lock"
"""The file that is held; it stays when nobody holds it, and means nothing then."""


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Nobody else writes into the folder while this lasts; a process that dies lets go of it.

    Raises:
        InputError: somebody else does.
        OSError: a link stands in the place of the lock, and is not followed.
    """
    lock = filelock.FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise InputError(f"{folder} is being written by another process: wait for it, or name another folder") from None
    try:
        yield
    finally:
        lock.release()
