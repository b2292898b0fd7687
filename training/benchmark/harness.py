"""Sensor steps per second, measured in turns: every candidate works for a moment, round after round.

A machine's speed drifts by tens of per cent while a benchmark runs. Working in turns, each candidate meets the same
machine, and the ratio within a round is steadier than any rate. What is counted is a *sensor step*: one measurement,
one prediction and one update, whatever the decision interval.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from gymnasium.vector import AutoresetMode

from passloc_env import LocalisationEnv, LocalisationVectorEnv, Scenario
from passloc_env.spaces import observation_space
from training.benchmark import limit
from training.benchmark.filterpy_env import FilterPyEnv
from training.benchmark.recording import Look, Replayed
from training.benchmark.report import Row, Stepping, spread

PEER = "FilterPy environment"
_MANY = 256
"""Environments from which the limit is one: a few leave most of the processor's width idle."""

_DRAWN_ACTIONS = 61
"""Rows of actions drawn ahead of time: prime, so that they fall out of step with the episodes."""


@dataclass(frozen=True)
class Slice:
    """What was done in one turn."""

    steps: int
    cpu: float
    wall: float

    @property
    def per_cpu_second(self) -> float:
        """Sensor steps per second of processor time."""
        return self.steps / self.cpu

    @property
    def per_wall_second(self) -> float:
        """Sensor steps per second on the clock."""
        return self.steps / self.wall


class Candidate(Protocol):
    """Something whose speed is measured."""

    @property
    def name(self) -> str:
        """What it is."""

    @property
    def environments(self) -> int:
        """How many run together."""

    @property
    def note(self) -> str:
        """What sets it apart from the others of its table; empty when nothing does."""

    def warm_up(self) -> None:
        """Whatever comes before measuring."""

    def step(self) -> int:
        """One call of the interface; the number of sensor steps done."""


class VectorCandidate:
    """passloc's vector environment in its default autoreset mode."""

    name, note = "passloc, vector", ""

    def __init__(self, scenario: Scenario, environments: int, random: np.random.Generator, workers: int = 1) -> None:
        self.environments = environments
        mode = AutoresetMode.NEXT_STEP
        self.env = LocalisationVectorEnv(environments, scenario, autoreset_mode=mode, workers=workers)
        self._actions = _draw_actions(scenario, random, environments)
        self._decision_every, self._decisions = scenario.episode.decision_every, decisions(scenario)
        self._call = 0
        self._ended = np.zeros(environments, bool)

    def warm_up(self) -> None:
        """Start the environments in the course of one episode, so that their ends are spread evenly.

        Reset together they would also end together, and a slice shorter than an episode would hold either all resets
        or none.
        """
        self._observation, _ = self.env.reset(seed=0)
        group = np.arange(self.environments) * self._decisions // self.environments
        for decision in range(self._decisions):
            self.step()
            now = group == decision
            if now.any():
                self.env.reset(options={"reset_mask": now})
                self._ended[now] = False

    def step(self) -> int:
        """A call; environments that it only resets do not count."""
        self._observation, _, terminated, truncated, _ = self.env.step(self._act())
        flown = self.environments - int(np.count_nonzero(self._ended))
        self._ended = terminated | truncated
        return flown * self._decision_every

    def _act(self) -> np.ndarray:
        self._call += 1
        return self._actions[self._call % _DRAWN_ACTIONS]


class NetworkCandidate(VectorCandidate):
    """The same with a policy: a network of two layers of 64 units looks at every observation."""

    name = "passloc, vector + network"

    def __init__(self, scenario: Scenario, environments: int, random: np.random.Generator) -> None:
        super().__init__(scenario, environments, random)
        features = observation_space(scenario).shape[0]
        self._weights = [
            random.normal(0.0, rows**-0.5, (rows, columns)).astype(np.float32)
            for rows, columns in pairwise((features, 64, 64, scenario.action_size))
        ]

    def _act(self) -> np.ndarray:
        values = self._observation
        for weights in self._weights:
            values = np.tanh(values @ weights)
        return values


class WorkersCandidate(VectorCandidate):
    """The same on several processes."""

    def __init__(self, scenario: Scenario, environments: int, random: np.random.Generator, workers: int) -> None:
        super().__init__(scenario, environments, random, workers)
        self.name = f"passloc, {workers} workers"


class ScalarCandidate:
    """One Gymnasium environment, reset whenever its episode ends."""

    environments, note = 1, ""

    def __init__(
        self, name: str, env: LocalisationEnv | FilterPyEnv, scenario: Scenario, random: np.random.Generator
    ) -> None:
        self.name, self._env = name, env
        self._actions = _draw_actions(scenario, random, 1)[:, 0]
        self._decision_every, self._decisions = scenario.episode.decision_every, decisions(scenario)
        self._call = 0

    def warm_up(self) -> None:
        """One episode."""
        self._env.reset(seed=0)
        for _ in range(self._decisions):
            self.step()

    def step(self) -> int:
        """A decision."""
        actions = self._actions[self._call % _DRAWN_ACTIONS]
        self._call += 1
        _, _, terminated, truncated, _ = self._env.step(actions)
        if terminated or truncated:
            self._env.reset()
        return self._decision_every


class StoneSoupCandidate(Replayed):
    """Stone Soup's filter on recorded measurements."""

    name = "Stone Soup filter"
    note = "tracker only: no world, bound, reward or observation"

    def __init__(self, scenario: Scenario, random: np.random.Generator) -> None:
        from training.benchmark.stone_soup import StoneSoupTracker

        super().__init__(scenario, random)
        self._tracker = StoneSoupTracker(scenario)

    def start(self, look: Look) -> None:
        """Begin to track from the first look."""
        self._tracker.start(look)

    def hear(self, look: Look) -> None:
        """A prediction and an update."""
        self._tracker.step(look)


def measure_stepping(scenario: Scenario, sizes: Sequence[int], rounds: int, seconds: float) -> Stepping:
    """Every candidate against the FilterPy environment.

    Args:
        scenario: one that both can run, with bearing and Doppler.
        sizes: numbers of environments for the vector environment.
        rounds: how often each candidate has its turn.
        seconds: wall time of each turn at least, s.
    """
    candidates, notes = _candidates(scenario, sizes)
    rows = compare(candidates, [candidates[0]] * len(candidates), rounds, seconds)
    return Stepping(scenario.name, rounds, seconds, rows, notes + _shares(rows))


def measure_states(scenario: Scenario, sizes: Sequence[int], rounds: int, seconds: float) -> Stepping:
    """A scenario with another number of states against the FilterPy environment of the same; arguments as above."""
    random = np.random.default_rng(0)
    peer = ScalarCandidate(PEER, FilterPyEnv(scenario), scenario, random)
    vectors = [VectorCandidate(scenario, size, random) for size in sizes]
    rows = compare([peer, *vectors], [peer] * (1 + len(vectors)), rounds, seconds)
    states = len(vectors[0].env.belief.mean)
    return Stepping(f"{scenario.name}, {states} states", rounds, seconds, rows, [])


def measure_workers(scenario: Scenario, sizes: Sequence[int], workers: int, rounds: int, seconds: float) -> Stepping:
    """Several processes against one, at each size; arguments as above."""
    random = np.random.default_rng(0)
    alone: list[Candidate] = [VectorCandidate(scenario, size, random) for size in sizes]
    crews = [WorkersCandidate(scenario, size, random, workers) for size in sizes]
    try:
        rows = compare([*alone, *crews], [*alone, *alone], rounds, seconds)
    finally:
        for crew in crews:
            crew.env.close()
    notes = ["Each against one process of the same size; only the wall clock counts, for it sees all processes."]
    return Stepping(f"{scenario.name}, {workers} workers", rounds, seconds, rows, notes)


def compare(candidates: Sequence[Candidate], peers: Sequence[Candidate], rounds: int, seconds: float) -> list[Row]:
    """Let everybody work in turns; one row per candidate, with its ratio to its own peer, which is another of them."""
    slices = run_in_turns(candidates, rounds, seconds)
    of_peers = [slices[candidates.index(peer)] for peer in peers]
    return [_row(candidate, own, theirs) for candidate, own, theirs in zip(candidates, slices, of_peers, strict=True)]


def run_in_turns(candidates: Sequence[Candidate], rounds: int, seconds: float) -> list[list[Slice]]:
    """Let everybody work in turns; what each did in every round."""
    for candidate in candidates:
        candidate.warm_up()
    slices: list[list[Slice]] = [[] for _ in candidates]
    for _ in range(rounds):
        for candidate, own in zip(candidates, slices, strict=True):
            own.append(_slice(candidate, seconds))
    return slices


def _candidates(scenario: Scenario, sizes: Sequence[int]) -> tuple[list[Candidate], list[str]]:
    """The candidates, the peer first, and notes on what was left out."""
    random = np.random.default_rng(0)
    candidates: list[Candidate] = [ScalarCandidate(PEER, FilterPyEnv(scenario), scenario, random)]
    notes = [
        f"The {PEER} is stepped alone: of many, each costs the same.",
        "Resets are included. The clocks of the vector environments are spread over an episode.",
    ]
    try:
        candidates.append(StoneSoupCandidate(scenario, random))
    except ModuleNotFoundError as error:
        # Anything else that is missing is a fault to be seen.
        if (error.name or "").partition(".")[0] != "stonesoup":
            raise
        notes.append("Stone Soup is not installed and was left out: pip install stonesoup")
    candidates.append(ScalarCandidate("passloc, scalar", LocalisationEnv(scenario), scenario, random))
    candidates += [VectorCandidate(scenario, size, random) for size in sizes]
    if sizes:
        candidates.append(NetworkCandidate(scenario, max(sizes), random))
    if sizes and limit.library() is not None:
        candidates.append(limit.LimitCandidate(scenario, max(sizes)))
    return candidates, notes


def _shares(rows: Sequence[Row]) -> list[str]:
    """What part of the limit is reached, where there is a limit."""
    limits = [row for row in rows if row.name == limit.LimitCandidate.name]
    notes = []
    for row in rows:
        if limits and row.name == VectorCandidate.name and row.environments >= _MANY:
            share = row.per_cpu_second.median / limits[0].per_cpu_second.median
            notes.append(f"N = {row.environments}: {share:.2f} of what the C kernel does.")
    return notes


def _slice(candidate: Candidate, seconds: float) -> Slice:
    steps = 0
    cpu, wall = time.process_time(), time.perf_counter()
    while steps == 0 or time.perf_counter() - wall < seconds:
        steps += candidate.step()
    return Slice(steps, time.process_time() - cpu, time.perf_counter() - wall)


def _row(candidate: Candidate, own: list[Slice], peer: list[Slice]) -> Row:
    pairs = list(zip(own, peer, strict=True))
    return Row(
        candidate.name,
        candidate.environments,
        spread([mine.per_cpu_second for mine in own]),
        spread([mine.per_wall_second for mine in own]),
        spread([mine.per_cpu_second / other.per_cpu_second for mine, other in pairs]),
        spread([mine.per_wall_second / other.per_wall_second for mine, other in pairs]),
        candidate.note,
    )


def _draw_actions(scenario: Scenario, random: np.random.Generator, environments: int) -> np.ndarray:
    """Actions ``(rows, environments, a)``, float32."""
    shape = (_DRAWN_ACTIONS, environments, scenario.action_size)
    return random.uniform(-1.0, 1.0, shape).astype(np.float32)


def decisions(scenario: Scenario) -> int:
    """Decisions of an episode."""
    return scenario.episode.steps // scenario.episode.decision_every
