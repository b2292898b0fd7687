"""Where independent tasks are done: in this process, on several of this machine, on a Ray cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from passloc_env.errors import InputError
from training.arguments import at_least_one
from training.commands.fields import Work
from training.engines.alone import ALONE
from training.engines.interface import ATTEMPTS, Engine

__all__ = ["ALONE", "ATTEMPTS", "Engine", "opened"]


@contextmanager
def opened(work: Work) -> Iterator[Engine]:
    """The engine that a command line asks for; its processes end with the context, however that is left.

    Raises:
        InputError: fewer than one worker, or an address that nobody would look at or nobody answers.
        ModuleNotFoundError: Ray is not installed.
    """
    if work.workers is not None:
        at_least_one(workers=work.workers)
    if work.engine == "ray":
        from training.engines.ray import Ray

        cluster = Ray(work.workers, work.address)
        try:
            yield cluster
        finally:
            cluster.close()
        return
    if work.address:
        raise InputError(f"address = {work.address!r} is not possible: it is a cluster's, for --engine ray")
    if work.workers in (None, 1):
        yield ALONE
        return
    from training.engines.local import Local

    processes = Local(work.workers)
    try:
        yield processes
    finally:
        processes.close()
