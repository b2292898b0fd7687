"""Tasks on a Ray cluster, or on a cluster of this machine alone; needs the extra ``distributed``."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import ray

from passloc_env.errors import InputError, WorkerError
from training.engines.interface import ATTEMPTS, Outcome, Result, outcome


class Ray:
    """See :class:`training.engines.interface.Engine`.

    Every machine of the cluster needs the same passloc; tasks and results go over the network, files do not.

    Args:
        workers: how many tasks at once; None for as many as the cluster has processors.
        address: of the cluster, ``auto`` for the one that this machine belongs to; empty to start one here that ends
            with this engine.

    Raises:
        InputError: there is no cluster at the address.
    """

    sees_files = False

    def __init__(self, workers: int | None = None, address: str = "") -> None:
        quiet = {"log_to_driver": False, "logging_level": "error"}
        try:
            if address:
                ray.init(address, **quiet)
            else:
                ray.init("local", num_cpus=workers, include_dashboard=False, **quiet)
        except (ConnectionError, ValueError, RuntimeError) as error:
            reason = str(error).partition("\n")[0]
            raise InputError(f"address = {address!r} is not possible: {reason}") from None
        self.workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._call = ray.remote(num_cpus=1, max_retries=ATTEMPTS - 1)(_call)

    def map(self, function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Result]]:
        """So many tasks at once as there are workers; Ray begins those again whose worker dies."""
        waiting, flying = iter(enumerate(tasks)), dict[Any, int]()
        try:
            while True:
                while len(flying) < self.workers and (task := next(waiting, None)):
                    index, arguments = task
                    flying[self._call.remote(sys.argv, function, arguments)] = index
                if not flying:
                    return
                (done, *_), _ = ray.wait(list(flying), num_returns=1)
                index = flying.pop(done)
                yield index, self._received(done, index).result()
        finally:
            for reference in flying:
                ray.cancel(reference, force=True)

    def close(self) -> None:
        """Leave the cluster, or end the one that was started here."""
        ray.shutdown()

    def _received(self, reference: Any, index: int) -> Outcome:
        try:
            found: Outcome = ray.get(reference)
        except ray.exceptions.RayError as error:
            reason = str(error).partition("\n")[0]
            raise WorkerError(f"task {index} has ended {ATTEMPTS} workers, the last by {reason}") from None
        return found


def _call(words: list[str], function: Callable[..., Any], arguments: tuple[Any, ...]) -> Outcome:
    """A call on a worker, where the command that results say they come from is the one that was typed."""
    with contextlib.ExitStack() as stack:
        stack.callback(setattr, sys, "argv", sys.argv)
        sys.argv = words
        return outcome(function, arguments)
