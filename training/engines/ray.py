"""Tasks on a Ray cluster, or on a cluster of this machine alone; needs the extra ``distributed``."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import IO, Any
from urllib.parse import urlsplit

import ray
from ray.exceptions import NodeDiedError, OutOfMemoryError, RayError, WorkerCrashedError

from passloc_env.errors import InputError, WorkerError
from training.engines.interface import ATTEMPTS, Outcome, Result, outcome

_DIED = (NodeDiedError, OutOfMemoryError, WorkerCrashedError)
_PATIENCE = 5.0
"""Seconds that whoever listens at an address has to answer."""
_SECRET = "the cluster wants its token: set RAY_AUTH_MODE=token, and have its ~/.ray/auth_token on this machine"
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


class Ray:
    """See :class:`training.engines.interface.Engine`.

    Every machine of the cluster needs the same passloc; tasks and results go over the network, files do not.

    Args:
        workers: how many tasks at once; None for as many as the cluster has processors.
        address: of the cluster, ``host:port``, or ``auto`` for the one that this machine belongs to; empty to start one
            here that ends with this engine.

    Raises:
        InputError: there is no cluster at the address, or it does not let us in.
    """

    sees_files = False

    def __init__(self, workers: int | None = None, address: str = "") -> None:
        self._asked, self._address = workers, address
        self._open()
        self.workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._call = ray.remote(num_cpus=1, max_retries=ATTEMPTS - 1)(_call)

    def map(self, function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Result]]:
        """So many tasks at once as there are workers; Ray begins those again whose worker dies."""
        if not ray.is_initialized():
            self._open()
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
                yield index, _received(done, index).result()
        except BaseException:
            # A cluster ends the tasks of who leaves it. To cancel them instead, even gently, now and then aborts this
            # process: Ray does not bear that a task is done while it is being cancelled.
            self.close()
            raise

    def close(self) -> None:
        """Leave the cluster, or end the one that was started here."""
        ray.shutdown()

    def _open(self) -> None:
        # Otherwise Ray reports to its makers how it is used, from the machine that starts the cluster.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        quiet = {"log_to_driver": False, "logging_level": "error"}
        with _same_end():
            if self._address:
                _join(self._address, **quiet)
            else:
                ray.init("local", num_cpus=self._asked, include_dashboard=False, **quiet)


def _join(address: str, **options: Any) -> None:
    """Connect to a cluster that is there already, without what Ray's libraries say meanwhile."""
    if address != "auto":
        _call_at(address)
    with tempfile.TemporaryFile() as said, _errors_into(said):
        try:
            ray.init(address, **options)
        except (RayError, OSError, ValueError, RuntimeError) as error:
            said.seek(0)
            if b"InvalidAuthToken" in said.read():
                raise _not_possible(address, _SECRET) from None
            raise _not_possible(address, str(error).partition("\n")[0]) from None


def _call_at(address: str) -> None:
    """Make sure that somebody listens at an address: Ray itself would try for ten minutes."""
    try:
        place = urlsplit(address if "://" in address else f"//{address}")
        host, port = place.hostname, place.port
    except ValueError:
        host = port = None
    if host is None or port is None:
        raise _not_possible(address, "a cluster is at host:port, or auto for that of this machine")
    try:
        socket.create_connection((host, port), timeout=_PATIENCE).close()
    except OSError as error:
        raise _not_possible(address, f"nobody answers there ({error.strerror or error})") from None


def _not_possible(address: str, reason: str) -> InputError:
    return InputError(f"address = {address!r} is not possible: {reason}")


def _received(reference: Any, index: int) -> Outcome:
    try:
        found: Outcome = ray.get(reference)
    except _DIED as error:
        raise WorkerError(f"task {index} has ended {ATTEMPTS} workers, the last by {_lines(error)[0]}") from None
    except RayError as error:
        raise WorkerError(f"task {index} could not be done: {_lines(error)[-1]}") from None
    return found


def _lines(error: RayError) -> list[str]:
    return _COLOUR.sub("", str(error)).strip().splitlines() or [type(error).__name__]


def _call(words: list[str], function: Callable[..., Any], arguments: tuple[Any, ...]) -> Outcome:
    """A call on a worker, where the command that results say they come from is the one that was typed."""
    with contextlib.ExitStack() as stack:
        stack.callback(setattr, sys, "argv", sys.argv)
        sys.argv = words
        return outcome(function, arguments)


@contextlib.contextmanager
def _same_end() -> Iterator[None]:
    """Ray, as it is started, gives SIGTERM a meaning of its own; afterwards it has the former one."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def _errors_into(file: IO[bytes]) -> Iterator[None]:
    """Meanwhile a file gets what this process says on standard error, libraries in other languages included."""
    kept = os.dup(2)
    os.dup2(file.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
