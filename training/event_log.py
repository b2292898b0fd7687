"""TensorBoard's events of a training, written by a thread whose faults must not be told twice."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stable_baselines3.common.logger import Logger, configure

from training.run_folder import EVENTS


@contextmanager
def event_log(run: Path) -> Iterator[Logger]:
    """A logger into a run folder.

    Where the disk is full its thread dies, and says so itself; the next event then raises the same OSError, which is
    told in one line.
    """
    before = threading.excepthook

    def hook(arguments: threading.ExceptHookArgs) -> None:
        if not issubclass(arguments.exc_type, OSError):
            before(arguments)

    threading.excepthook = hook
    try:
        yield configure(str(run / EVENTS), ["tensorboard"])
    finally:
        threading.excepthook = before
