"""The limit: a sensor step of BearingDoppler written by hand in C, to be compared with and never to be flown.

It is built by the system's compiler, when there is one, for this very processor and with every liberty of arithmetic.
It leaves out openings, decisions, observations and repairs, so passloc cannot come all the way.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from passloc_env import Scenario
from passloc_env.arrays import Array, lasting
from passloc_env.motion import ConstantVelocity
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.rewards import KeepOut
from passloc_env.sensors import Bearing, Doppler
from passloc_env.simulation import Simulation
from passloc_env.tracking import UnscentedKalman

SOURCE = Path(__file__).with_name("step.c")

_OPTIONS = ("-O3", "-march=native", "-mprefer-vector-width=512", "-ffast-math", "-fPIC")

_CHUNK = 512
"""Environments whose rows stay in the cache for all sensor steps of a decision."""

_LOWER = np.tril_indices(4)

ERRORS, NIS, TERMS, CLOSEST = slice(51, 53), 53, slice(54, 58), 58
"""Where the step finds errors, and leaves what is no state; the state comes before."""

_NUMBERS = (
    "period",
    "turn_rate",
    "bearing_sigma",
    "doppler_sigma",
    "shift",
    "track_noise",
    "bound_noise",
    "spread",
    "correction",
    "min_range",
    "margin",
)


class Numbers(ctypes.Structure):
    """The scenario's numbers, as the C code wants them."""

    _fields_ = [(name, ctypes.c_double) for name in _NUMBERS]

    @classmethod
    def of(cls, scenario: Scenario) -> Numbers:
        """Those of BearingDoppler, or of another with the same components."""
        own, tracker, motion = scenario.platforms[0], scenario.tracker, scenario.bound.motion
        bearing, doppler = scenario.sensors
        assert isinstance(own, TurnLimitedPlatform)
        assert isinstance(bearing, Bearing)
        assert isinstance(doppler, Doppler)
        assert isinstance(tracker, UnscentedKalman)
        assert isinstance(tracker.motion, ConstantVelocity)
        assert isinstance(motion, ConstantVelocity)
        return cls(
            period=scenario.episode.period,
            turn_rate=own.max_turn_rate,
            bearing_sigma=bearing.sigma,
            doppler_sigma=doppler.sigma,
            shift=-doppler.carrier / doppler.propagation_speed,
            track_noise=tracker.motion.acceleration_noise**2,
            bound_noise=motion.acceleration_noise**2,
            spread=tracker.alpha**2 * (4 + tracker.kappa),
            correction=tracker.beta - tracker.alpha**2,
            min_range=scenario.episode.min_range,
            margin=next(term.margin for term in scenario.reward if isinstance(term, KeepOut)),
        )


@cache
def library() -> Any:
    """The compiled functions ``sensor_step`` and ``draw_errors``; None without a C compiler that can build them."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        unit, path = f"{folder}/step.o", f"{folder}/step.so"
        # Linked with -ffast-math, a library would make the whole process round subnormal numbers to zero.
        commands = [[*_OPTIONS, "-c", str(SOURCE), "-o", unit], ["-shared", unit, "-o", path, "-lm"]]
        if any(subprocess.run([compiler, *command], capture_output=True).returncode for command in commands):
            return None
        found = ctypes.CDLL(path)
    pointer, number = ctypes.c_void_p, ctypes.c_long
    found.sensor_step.restype = found.draw_errors.restype = None
    found.sensor_step.argtypes = [pointer, number, number, ctypes.c_double, ctypes.POINTER(Numbers)]
    found.draw_errors.argtypes = [pointer, pointer, number, number]
    return found


def rows_of(simulation: Simulation) -> Array:
    """The state of a simulation as the C code wants it, ``(59, N)``; errors, terms and the closest range are blank."""
    motion: Any = simulation.realised.target.motion
    arrays = simulation.state_arrays()
    own: Any = simulation.realised.platforms[0]
    numbers = (own.speed, motion.start, motion.duration, motion.acceleration, motion.turn_rate, motion.kind)
    bound, free = simulation.information.covariance[:, :, 0], simulation.information.covariance[:, :, -1]
    state = [simulation.truth, arrays["platform.0"], arrays["set_point.0"], np.stack(numbers)]
    state += [simulation.track.mean, simulation.track.covariance[_LOWER], bound[_LOWER], free[_LOWER]]
    blank = np.zeros((8, simulation.environments))
    blank[-1] = np.inf
    return np.concatenate([*state, blank])


class LimitCandidate:
    """The C step for so many environments, from the state of a simulation in flight, time and again."""

    name, note = "C kernel, the limit", "one sensor step only: no openings, decisions or observations"

    def __init__(self, scenario: Scenario, environments: int) -> None:
        self.environments, self._library, self._numbers = environments, library(), Numbers.of(scenario)
        simulation = Simulation(scenario, environments)
        simulation.reset(np.arange(environments), [np.random.default_rng(seed) for seed in range(environments)])
        simulation.step(np.zeros((1, environments)))
        self._begun = rows_of(simulation)
        self._rows = lasting((len(self._begun), environments))
        self._stride = self._rows.strides[0] // self._rows.itemsize
        self._seeds = np.random.default_rng(0).integers(1, 2**64 - 1, (4, self._stride), dtype=np.uint64)
        self._time, self._episode = scenario.episode.duration, scenario.episode

    def warm_up(self) -> None:
        """Begin anew."""
        self._time = self._episode.interval
        self._rows[...] = self._begun

    def step(self) -> int:
        """The sensor steps of a decision, chunk by chunk."""
        if self._time >= self._episode.duration:
            self.warm_up()
        for first in range(0, self.environments, _CHUNK):
            size, ahead = min(_CHUNK, self.environments - first), 8 * first
            rows, seeds = self._rows.ctypes.data + ahead, self._seeds.ctypes.data + ahead
            for step in range(self._episode.decision_every):
                time = self._time + step * self._episode.period
                self._library.draw_errors(rows, seeds, self._stride, size)
                self._library.sensor_step(rows, self._stride, size, time, ctypes.byref(self._numbers))
        self._time += self._episode.interval
        return self.environments * self._episode.decision_every
