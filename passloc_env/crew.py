"""A batch flown by several processes: each has a share of the environments, the first share stays in this one.

The workers answer over pipes, and lay their arrays down in shared memory. Environments never touch each other, so the
shares change nothing but the speed.
"""

from __future__ import annotations

import multiprocessing
import pickle
import signal
import time
import weakref
from collections.abc import Callable
from itertools import pairwise
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from passloc_env.arrays import Array, BoolArray
from passloc_env.batch import Batch, Round, Verdict, join_beliefs
from passloc_env.belief import Belief
from passloc_env.errors import WorkerError
from passloc_env.scenario import Scenario
from passloc_env.slab import Slab

_FEWEST = 512
"""Environments per worker below which the pipes cost more than the second processor gives."""

_ANSWER = 1024
"""Bytes of an answer to be shared, for each environment: what a step returns takes a few hundred."""

_HEAD_START = 128
"""Environments that this process steps while a worker is woken and its answer brought: so many more are its own."""

_PATIENCE = 1e-3
"""How long to look for an answer without a rest, s."""

_GONE = (EOFError, BrokenPipeError, ConnectionResetError)


def build_batch(scenario: Scenario, size: int, workers: int) -> Batch | CrewBatch:
    """A batch on at most so many processes: as many as pay at its size."""
    paying = min(workers, size // _FEWEST)
    return CrewBatch(scenario, size, paying) if paying > 1 else Batch(scenario, size)


class Worker:
    """A process that holds a share of the environments.

    Args:
        scenario: what they are.
        share: which environments of the whole.
        title: what errors call it.
    """

    def __init__(self, scenario: Scenario, share: slice, title: str) -> None:
        self.share, self._title = share, title
        # A spawned process inherits no locks that threads of this one may hold.
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        size = share.stop - share.start
        self._slab = Slab(context, size * _ANSWER)
        self.process = context.Process(
            target=_serve, args=(theirs, self._slab, scenario, size), daemon=True, name=title
        )
        self.process.start()
        theirs.close()
        self.close = weakref.finalize(self, _dismiss, self._pipe, self.process)

    def ask(self, method: str, *arguments: Any) -> None:
        """Have it call a method of its :class:`Batch`; :meth:`answer` tells the result."""
        try:
            self._pipe.send_bytes(pickle.dumps((method, arguments), protocol=5))
        except (*_GONE, OSError):
            raise self._died() from None

    def answer(self) -> tuple[Exception | None, Any]:
        """What the method asked for last raised, and what it returned; WorkerError when the process is gone.

        Arrays are good until the next answer: whoever keeps them must copy them.
        """
        try:
            outcome: tuple[Exception | None, Any] = self._slab.unpack(_received(self._pipe))
        except (*_GONE, OSError):
            raise self._died() from None
        return outcome

    def _died(self) -> WorkerError:
        self.process.join(1.0)
        code = self.process.exitcode
        first, last = self.share.start, self.share.stop - 1
        return WorkerError(
            f"{self._title} has died (exit code {code}) and with it environments {first} to {last}: "
            "the batch is lost, build a new environment. A script that uses workers must start its work under "
            "'if __name__ == \"__main__\":'"
        )


def _serve(pipe: Connection, slab: Slab, scenario: Scenario, size: int) -> None:
    """The life of a worker: answer until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    batch = Batch(scenario, size)
    while True:
        try:
            method, arguments = _received(pipe)
            pipe.send_bytes(pickle.dumps(slab.pack(_outcome(batch, method, arguments)), protocol=5))
        except _GONE:
            return


def _received(pipe: Connection) -> Any:
    """What comes through a pipe. It is often near, and to be woken takes longer than to look a few times more."""
    deadline = time.perf_counter() + _PATIENCE
    while not pipe.poll() and time.perf_counter() < deadline:
        pass
    return pickle.loads(pipe.recv_bytes())


def _outcome(batch: Batch, method: str, arguments: tuple[Any, ...]) -> tuple[Exception | None, Any]:
    """What a method raises, and what it returns; attributes are asked for like methods."""
    try:
        attribute = getattr(batch, method)
        return None, attribute(*arguments) if callable(attribute) else attribute
    except Exception as error:
        return error, None


def _dismiss(pipe: Connection, process: BaseProcess) -> None:
    pipe.close()
    process.join(0.5)
    if process.is_alive():
        process.terminate()


class CrewBatch:
    """The interface of :class:`Batch` over several processes.

    Raises:
        WorkerError: from every method, once a worker has died.
    """

    def __init__(self, scenario: Scenario, size: int, workers: int) -> None:
        self.scenario, self.size = scenario, size
        ahead = min(_HEAD_START, size // workers)
        edges = [0, *(ahead + (size - ahead) * index // workers for index in range(1, workers + 1))]
        shares = [slice(first, last) for first, last in pairwise(edges)]
        self._own_share = shares[0]
        self.workers = [
            Worker(scenario, share, f"worker {index} of {workers}") for index, share in enumerate(shares[1:], 2)
        ]
        self._own = Batch(scenario, shares[0].stop)

    def close(self) -> None:
        """Send the workers home."""
        for worker in self.workers:
            worker.close()

    @property
    def tiles(self) -> list[Any]:
        """ValueError: the worlds live in other processes."""
        raise ValueError("with workers the worlds live in other processes: build the environment with workers=1")

    def _all(self, method: str, cut: Callable[[slice], tuple[Any, ...]] = lambda share: ()) -> list[Any]:
        """Every share's result of a method, with the arguments cut to the share."""
        try:
            for worker in self.workers:
                worker.ask(method, *cut(worker.share))
            outcomes = [_outcome(self._own, method, cut(self._own_share))]
            outcomes += [worker.answer() for worker in self.workers]
        except BaseException:
            # An answer may still be under way: nobody could tell it from that to the next question.
            self.close()
            raise
        for error, _ in outcomes:
            if error is not None:
                raise error
        return [result for _, result in outcomes]

    def seed_all(self, mask: BoolArray, seeds: list[int | None]) -> None:
        """Give the environments of a mask ``(N,)`` new generators, or their first ones where a seed is None."""
        self._all("seed_all", lambda share: (mask[share], seeds[share]))

    def reset(self, mask: BoolArray) -> None:
        """Begin new episodes where ``mask (N,)``."""
        self._all("reset", lambda share: (mask[share],))

    def fly(self, actions: Array, resetting: BoolArray, same_step: bool, diagnostics: bool) -> Round:
        """See :meth:`Batch.fly`."""
        rounds: list[Round] = self._all("fly", lambda share: (actions[share], resetting[share], same_step, diagnostics))
        last = None
        if any(each.last is not None for each in rounds):
            before = [each.last or (each.observation, each.info) for each in rounds]
            last = np.concatenate([observation for observation, _ in before]), _joined([info for _, info in before], 0)
        return Round(
            np.concatenate([each.observation for each in rounds]),
            Verdict(*(np.concatenate(parts) for parts in zip(*(each.verdict for each in rounds), strict=True))),
            _joined([each.info for each in rounds], 0),
            last,
        )

    def observe(self) -> np.ndarray:
        """Observations ``(N, f)``, float32."""
        return np.concatenate(self._all("observe"))

    def info(self, diagnostics: bool) -> dict[str, Any]:
        """See :meth:`Batch.info`."""
        return _joined(self._all("info", lambda share: (diagnostics,)), axis=0)

    @property
    def belief(self) -> Belief:
        """What policies may know, of all environments; a copy."""
        return join_beliefs(self._all("belief"))

    def get_generators(self) -> list[Any]:
        """The state of every environment's generator; None where there is none yet."""
        return [state for part in self._all("get_generators") for state in part]

    def set_generators(self, states: list[Any]) -> None:
        """Put them back."""
        self._all("set_generators", lambda share: (states[share],))

    def get_arrays(self) -> dict[str, np.ndarray]:
        """A copy of the state, batch axis last, by name."""
        return _joined(self._all("get_arrays"), axis=-1)

    def check_arrays(self, arrays: dict[str, np.ndarray]) -> None:
        """ValueError when a state from :meth:`get_arrays` does not fit."""
        self._all("check_arrays", lambda share: (_cut(arrays, share),))

    def set_arrays(self, arrays: dict[str, np.ndarray]) -> None:
        """Put a state from :meth:`get_arrays` back; ValueError, with nothing changed, when it does not fit."""
        self.check_arrays(arrays)
        self._all("put_arrays", lambda share: (_cut(arrays, share),))


def _cut(arrays: dict[str, np.ndarray], share: slice) -> dict[str, np.ndarray]:
    return {name: values[..., share] for name, values in arrays.items()}


def _joined(parts: list[dict[str, Any]], axis: int) -> dict[str, Any]:
    """Dictionaries of arrays, maybe nested, put end to end."""
    joined: dict[str, Any] = {}
    for name, first in parts[0].items():
        values = [part[name] for part in parts]
        joined[name] = _joined(values, axis) if isinstance(first, dict) else np.concatenate(values, axis=axis)
    return joined
