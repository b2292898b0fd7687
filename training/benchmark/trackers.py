"""Trackers alone: a batch of passloc's beside FilterPy's filters, one environment at a time.

FilterPy's side does less: it has the unscented filters that a tracker is made of, but neither weighs nor mixes them,
and all filters of a bank start from the same prior.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np

from passloc_env import Scenario
from passloc_env.arrays import Array
from passloc_env.platforms import Pose
from passloc_env.simulation import Simulation
from passloc_env.tracking import (
    InteractingModels,
    RangeBank,
    RangePrior,
    SquareRootKalman,
    Tracker,
    UnscentedKalman,
)
from training.benchmark.harness import compare, decisions
from training.benchmark.peer_tracking import Move, accelerated, build_filter, prior_covariance
from training.benchmark.peer_world import wrap
from training.benchmark.recording import Look, Replayed
from training.benchmark.report import Stepping


def turning(state: Array, period: float) -> Array:
    """East, north, their rates and the turn rate to starboard one period later."""
    east, north, v_east, v_north, rate = state.tolist()
    angle = rate * period
    if abs(angle) < 1e-9:
        return np.array([east + period * v_east, north + period * v_north, v_east, v_north, rate])
    sine, versine = math.sin(angle), 1.0 - math.cos(angle)
    return np.array(
        [
            east + (sine * v_east + versine * v_north) / rate,
            north + (sine * v_north - versine * v_east) / rate,
            (1.0 - versine) * v_east + sine * v_north,
            (1.0 - versine) * v_north - sine * v_east,
            rate,
        ]
    )


STRAIGHT: tuple[Move | None, int] = (None, 4)
MOTIONS: tuple[tuple[Move | None, int], ...] = (STRAIGHT, (accelerated, 6), (turning, 5))
"""What FilterPy's filters move by, and how many states that takes: those of :class:`InteractingModels`."""


class TrackerCandidate:
    """A batch of tracks on recorded measurements."""

    note = ""

    def __init__(self, name: str, scenario: Scenario, environments: int) -> None:
        self.name, self.environments = name, environments
        simulation = Simulation(scenario.override({"episode.early_end": False}), environments)
        generators = [np.random.default_rng(index) for index in range(environments)]
        simulation.reset(np.arange(environments), generators)
        self._track = simulation.track
        self._start = {key: array.copy() for key, array in self._track.state_arrays().items()}
        self._looks: list[tuple[Array, Array, list[Pose]]] = []
        simulation.watchers.append(self._record)
        random = np.random.default_rng(0)
        for _ in range(decisions(scenario)):
            simulation.step(random.uniform(-1.0, 1.0, (1, environments)))
        self._next = len(self._looks)

    def _record(self, simulation: Simulation) -> None:
        scene = simulation.scene()
        measurement, _ = simulation.measure(scene)
        time = simulation.time - simulation.scenario.episode.period
        self._looks.append((time, measurement, copy.deepcopy(scene.poses)))

    def warm_up(self) -> None:
        """One recording."""
        for _ in self._looks:
            self.step()

    def step(self) -> int:
        """A prediction and an update of every track."""
        if self._next == len(self._looks):
            for key, array in self._track.state_arrays().items():
                array[...] = self._start[key]
            self._next = 0
        time, measurement, poses = self._looks[self._next]
        self._next += 1
        self._track.predict(time)
        self._track.update(measurement, poses)
        return self.environments


class FilterCandidate(Replayed):
    """FilterPy's unscented filters side by side on the recorded measurements of one environment."""

    def __init__(self, name: str, scenario: Scenario, motions: Sequence[tuple[Move | None, int]]) -> None:
        super().__init__(scenario, np.random.default_rng(0))
        self.name = name
        self.note = "neither weighed nor mixed" if len(motions) > 1 else ""
        assert isinstance(scenario.prior, RangePrior)
        self._prior = scenario.prior
        self.filters = [build_filter(scenario, move, states) for move, states in motions]

    def start(self, look: Look) -> None:
        """Every filter from the prior, whatever it does not tell nearly zero."""
        guess, sigma = float(self._prior.range), math.sqrt(self.filters[0].R[0, 0])
        for kalman in self.filters:
            states = len(kalman.x)
            kalman.x = np.zeros(states)
            kalman.x[:2] = guess * math.sin(look.bearing), guess * math.cos(look.bearing)
            kalman.P = 1e-4 * np.eye(states)
            kalman.P[:4, :4] = prior_covariance(self._prior, look.bearing, guess * sigma)

    def hear(self, look: Look) -> None:
        """A prediction and an update of every filter."""
        for kalman in self.filters:
            kalman.predict()
            reference = math.atan2(kalman.x[0] - look.own.east, kalman.x[1] - look.own.north)
            measurement = np.array([wrap(look.bearing - reference), look.shift])
            kalman.update(measurement, own=look.own, reference=reference)


def measure_trackers(scenario: Scenario, environments: int, rounds: int, seconds: float) -> Stepping:
    """Every tracker against the FilterPy filters that it is made of.

    Args:
        scenario: one that FilterPy's side can run, with bearing and Doppler.
        environments: tracks in a batch.
        rounds: how often each candidate has its turn.
        seconds: wall time of each turn at least, s.
    """
    motion = scenario.tracker.motion
    bank = RangeBank(motion=motion)
    one = FilterCandidate("FilterPy, 1 filter", scenario, [STRAIGHT])
    many = FilterCandidate(f"FilterPy, {bank.members} filters", scenario, [STRAIGHT] * bank.members)
    mixed = FilterCandidate(f"FilterPy, {len(MOTIONS)} motions", scenario, MOTIONS)
    matches: list[tuple[str, Tracker, FilterCandidate]] = [
        ("unscented", UnscentedKalman(motion=motion), one),
        ("square root", SquareRootKalman(motion=motion), one),
        (f"bank of {bank.members}", bank, many),
        (f"{len(MOTIONS)} models", InteractingModels(), mixed),
    ]
    peers = [one, many, mixed]
    own = [TrackerCandidate(name, scenario.replace(tracker=tracker), environments) for name, tracker, _ in matches]
    rows = compare([*peers, *own], [*peers, *(peer for *_, peer in matches)], rounds, seconds)
    notes = ["Each tracker against as many FilterPy filters as it has; no world, bound, reward or observation."]
    return Stepping(f"{scenario.name}, trackers alone", rounds, seconds, rows, notes)
