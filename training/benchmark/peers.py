"""What others do with many environments: the FilterPy environment in Gymnasium's and Stable-Baselines3's wrappers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from passloc_env import Scenario
from training.benchmark.filterpy_env import FilterPyEnv
from training.benchmark.harness import PEER, Candidate, ScalarCandidate, compare, decisions
from training.benchmark.report import Stepping

TOGETHER = 8
"""Environments in each wrapper: processes of their own would not be told apart on a few cores if they were many."""


class WrappedCandidate:
    """FilterPy environments in a wrapper with a ``step`` of its own."""

    note, environments = "", TOGETHER

    def __init__(self, name: str, wrapper: Any, scenario: Scenario) -> None:
        self.name, self._wrapper = name, wrapper
        self._steps, self._decisions = TOGETHER * scenario.episode.decision_every, decisions(scenario)
        self._actions = np.random.default_rng(0).uniform(-1.0, 1.0, (TOGETHER, 1)).astype(np.float32)

    def warm_up(self) -> None:
        """One episode."""
        self._wrapper.reset()
        for _ in range(self._decisions):
            self.step()

    def step(self) -> int:
        """A decision of every environment."""
        self._wrapper.step(self._actions)
        return self._steps

    def close(self) -> None:
        """End its processes."""
        self._wrapper.close()


def measure_peers(scenario: Scenario, rounds: int, seconds: float) -> Stepping:
    """Every wrapper against the environment alone; arguments as for :func:`~training.benchmark.harness.compare`."""

    def make() -> FilterPyEnv:
        return FilterPyEnv(scenario)

    makers: list[Callable[[], Any]] = [make] * TOGETHER
    wrapped = [
        WrappedCandidate("SyncVectorEnv", gymnasium.vector.SyncVectorEnv(makers), scenario),
        WrappedCandidate("AsyncVectorEnv", gymnasium.vector.AsyncVectorEnv(makers), scenario),
        WrappedCandidate("DummyVecEnv", DummyVecEnv(makers), scenario),
        WrappedCandidate("SubprocVecEnv", SubprocVecEnv(makers), scenario),
    ]
    alone = ScalarCandidate(PEER, make(), scenario, np.random.default_rng(0))
    candidates: list[Candidate] = [alone, *wrapped]
    try:
        rows = compare(candidates, [alone] * len(candidates), rounds, seconds)
    finally:
        for candidate in wrapped:
            candidate.close()
    notes = ["AsyncVectorEnv and SubprocVecEnv work in processes of their own: only their wall clock counts."]
    return Stepping(f"{scenario.name}, the {PEER} in wrappers", rounds, seconds, rows, notes)
