"""Tasks on several processes of this machine, each of them on one thread."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from passloc_env.errors import WorkerError
from training.engines.interface import ATTEMPTS, Outcome, Result, outcome

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_GONE = (EOFError, OSError)
"""What a pipe says whose other end is gone: before a message, in the middle of one, or when one is sent."""
_FAREWELL = 2.0
"""Seconds that a worker has to end when it is told to."""


class Local:
    """See :class:`training.engines.interface.Engine`; processes are started when there is work, and kept.

    A script that uses it must start its work under ``if __name__ == "__main__":``, since its processes import it.

    Args:
        workers: how many processes.
    """

    sees_files = True

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._hands: list[_Hand] = []

    def map(self, function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Result]]:
        """A task at a time for each process; that of a process which dies is given to another one."""
        waiting, begun = deque(range(len(tasks))), [0] * len(tasks)
        busy: dict[Any, tuple[_Hand, int]] = {}
        try:
            while waiting or busy:
                while waiting and len(busy) < self.workers:
                    hand, index = self._idle(busy), waiting.popleft()
                    begun[index] += 1
                    hand.give(function, tasks[index])
                    busy[hand.pipe] = hand, index
                for pipe in wait(list(busy)):
                    hand, index = busy.pop(pipe)
                    answer = hand.answer()
                    if answer is not None:
                        yield index, answer.result()
                        continue
                    self._hands.remove(hand)
                    if begun[index] == ATTEMPTS:
                        raise WorkerError(f"task {index} has ended {ATTEMPTS} workers, the last by {hand.end()}")
                    waiting.appendleft(index)
        except BaseException:
            # Answers may still be under way: nobody could tell them from those to later tasks.
            self.close()
            raise

    def close(self) -> None:
        """End all processes."""
        for hand in self._hands:
            hand.dismiss()
        self._hands.clear()

    def _idle(self, busy: dict[Any, tuple[_Hand, int]]) -> _Hand:
        for hand in self._hands:
            if hand.pipe not in busy:
                return hand
        self._hands.append(_Hand())
        return self._hands[-1]


class _Hand:
    """A process that does one task at a time."""

    def __init__(self) -> None:
        # A spawned process inherits no locks that threads of this one may hold, and no other worker's pipe, so that a
        # pipe ends when its worker does.
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _one_thread(), _uninterruptible():
            self.process.start()
        theirs.close()

    def give(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Have it call a function; that it has died is noticed when it is asked for the answer."""
        with contextlib.suppress(*_GONE):
            self.pipe.send_bytes(pickle.dumps((function, arguments), protocol=5))

    def answer(self) -> Outcome | None:
        """What the call came to; None when the process is gone."""
        try:
            message = self.pipe.recv_bytes()
        except _GONE:
            self.dismiss()
            return None
        found: Outcome = pickle.loads(message)
        return found

    def end(self) -> str:
        """How the process ended, in words."""
        code = self.process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"

    def dismiss(self) -> None:
        """End the process, in the middle of a task if need be."""
        self.pipe.close()
        self.process.join(0.1)
        if self.process.is_alive():
            self.process.terminate()
            self.process.join(_FAREWELL)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def _serve(pipe: Connection) -> None:
    """The life of a worker: answer until the pipe closes, or until nobody is left to answer to."""
    threading.Thread(target=_die_with_parent, daemon=True).start()
    with contextlib.suppress(*_GONE):
        while True:
            task = pipe.recv_bytes()
            pipe.send_bytes(pickle.dumps(outcome(_call, (task,)), protocol=5))


def _die_with_parent() -> None:
    """End this process with the one that started it, in the middle of a task if need be."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(task: bytes) -> Any:
    function, arguments = pickle.loads(task)
    return function(*arguments)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Libraries loaded by processes that are started meanwhile use one thread each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


@contextlib.contextmanager
def _uninterruptible() -> Iterator[None]:
    """Processes that are started meanwhile leave Ctrl-C to this one, which ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Started by the first process otherwise, and it would take the signal's mask off.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
