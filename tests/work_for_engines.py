"""Tasks that other processes import by name."""

import os
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from agents import Circle
from passloc_env.errors import ScenarioError

PLACE = "PASSLOC_TEST_PLACE"
"""Environment variable with the folder where tasks leave their marks: it reaches every worker."""


def square(number):
    return number * number


def who():
    return os.getpid()


def threads():
    return os.environ.get("OMP_NUM_THREADS")


def refuse(number):
    raise ScenarioError("number", number, "must be another")


def fail(number):
    raise ZeroDivisionError(f"task {number}\nwith a second line")


def killed_once(number, mortal):
    """The square of a number; the mortal number's first worker is killed before it can say so."""
    mark(f"{number}.{os.getpid()}")
    if number == mortal and len(marks(f"{number}.*")) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def killed_always(number):
    mark(f"{number}.{os.getpid()}")
    os.kill(os.getpid(), signal.SIGKILL)


def killed_while_answering(number, mortal):
    """The number, many times; the mortal number's first worker is killed while it sends that and nobody takes it in."""
    mark(f"{number}.{os.getpid()}")
    if number == mortal and len(marks(f"{number}.*")) == 1:
        while not marks("go"):
            time.sleep(0.01)
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return bytes([number]) * 20_000_000


def dawdle(number):
    """Never ends by itself."""
    mark(f"{number}.{os.getpid()}")
    while True:
        signal.pause()


def dawdle_from(number, first):
    """A number below the first of those for which this never ends."""
    return number if number < first else dawdle(number)


@dataclass(frozen=True)
class MortalCircle(Circle):
    """A circle whose first flight anywhere but in one process kills its worker half-way."""

    spared: int = 0

    def act(self, observation, belief, rng):
        if os.getpid() != self.spared and belief.time[0] > 0.0 and not marks("killed"):
            mark("killed")
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation, belief, rng)


def mark(name):
    (Path(os.environ[PLACE]) / name).touch()


def marks(pattern="*"):
    return sorted(path.name for path in Path(os.environ[PLACE]).glob(pattern))
