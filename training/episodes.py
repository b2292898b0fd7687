"""Flying whole episodes under a policy and keeping what happened at every sensor step."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from gymnasium.vector import AutoresetMode

from agents import Policy, TruthKnowing
from passloc_env.arrays import Array, BoolArray
from passloc_env.metrics import lost, root_trace, time_to
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from passloc_env.vector_env import LocalisationVectorEnv
from training.engines import ALONE, Engine

Watcher = TypeVar("Watcher")

CHUNK = 2048
"""Episodes flown at once at most; the histories of more would only cost memory."""


@dataclass
class Scores:
    """Per-episode scores of one policy, each ``(episodes,)``; times in seconds, errors relative to the range."""

    log_range_bound: Array
    end_error: Array
    mean_error: Array
    time_to_10: Array
    time_to_5: Array
    violated: BoolArray
    lost: BoolArray
    end_position_error: Array
    """Metres."""
    end_position_bound: Array
    """Root of the trace of the bound's position block, metres."""
    mean_nees: Array
    """Averaged over the episode; the number of states when consistent."""

    @classmethod
    def join(cls, parts: list[Scores]) -> Scores:
        """The scores of several batches as one."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


class Recorder:
    """Watches a simulation and keeps histories ``(steps, N)``."""

    def __init__(self, simulation: Simulation) -> None:
        steps, n = simulation.scenario.episode.steps, simulation.environments
        self.log_range_bound, self.error, self.nees = (np.zeros((steps, n)) for _ in range(3))
        self.violated = np.zeros((steps, n), bool)
        self._step, self._simulation = 0, simulation
        simulation.watchers.append(self._watch)

    def _watch(self, simulation: Simulation) -> None:
        outcome = simulation.outcome
        self.log_range_bound[self._step] = outcome.log_range_bound
        self.error[self._step] = outcome.relative_range_error
        self.nees[self._step] = outcome.nees
        self.violated[self._step] = outcome.violated
        self._step += 1

    def scores(self) -> Scores:
        """What the episodes came to, once they are over."""
        simulation = self._simulation
        period, outcome = simulation.scenario.episode.period, simulation.outcome
        position = simulation.information.dynamics.layout.position
        return Scores(
            log_range_bound=_mean(self.log_range_bound),
            end_error=self.error[-1],
            mean_error=_mean(self.error),
            time_to_10=time_to(0.10, self.error, period),
            time_to_5=time_to(0.05, self.error, period),
            violated=np.logical_or.reduce(self.violated, axis=0),
            lost=lost(self.error[-1], self.nees[-1]),
            end_position_error=self.error[-1] * outcome.range,
            end_position_bound=root_trace(simulation.information.bound, position),
            mean_nees=_mean(self.nees),
        )


def _mean(history: Array) -> Array:
    """Mean over time ``(N,)`` of ``(steps, N)``, in the order of time: NumPy sums a single episode in another one."""
    return sum(history, start=np.zeros(history.shape[1])) / len(history)


class Flight(NamedTuple):
    """Full episodes under a policy, seeds ``seed … seed + episodes − 1``, whatever the policy does.

    Entering ``min_range`` or losing the track is counted and ends nothing, so that no policy gains by ending early.

    Attributes:
        scenario: the problem; the policy's own overrides are applied.
        policy: who decides.
        episodes: how many.
        seed: of the first episode.
    """

    scenario: Scenario
    policy: Policy
    episodes: int
    seed: int


def fly(
    scenario: Scenario,
    policy: Policy,
    episodes: int,
    seed: int,
    progress: Callable[[int], None] = lambda done: None,
    engine: Engine = ALONE,
) -> tuple[Scores, float]:
    """The scores of one :class:`Flight`, and the seconds per decision that the policy took.

    Args:
        scenario: as of a flight.
        policy: as of a flight.
        episodes: as of a flight.
        seed: as of a flight.
        progress: called with the number of episodes finished since the last call.
        engine: where they are flown.
    """
    flight = Flight(scenario, policy, episodes, seed)
    ((_, scores, thinking),) = fly_all([flight], lambda _, done: progress(done), engine)
    return scores, thinking


def fly_all(
    flights: Sequence[Flight],
    progress: Callable[[int, int], None] = lambda flight, done: None,
    engine: Engine = ALONE,
) -> Iterator[tuple[int, Scores, float]]:
    """Fly several flights in batches; each flight's number, scores and seconds per decision once it is over.

    Args:
        flights: what to fly.
        progress: called with the number of a flight and of its episodes finished since the last call.
        engine: where they are flown.
    """
    tasks = [
        (number, first, count)
        for number, flight in enumerate(flights)
        for first, count in batches(flight.episodes, CHUNK, engine.workers)
    ]
    flown: dict[int, dict[int, tuple[Scores, float]]] = {}
    remaining = [flight.episodes for flight in flights]
    calls = [
        (flights[number].scenario, flights[number].policy, flights[number].seed, first, count)
        for number, first, count in tasks
    ]
    for task, result in engine.map(fly_batch, calls):
        number, first, count = tasks[task]
        flown.setdefault(number, {})[first] = result
        remaining[number] -= count
        progress(number, count)
        if not remaining[number]:
            parts = [part for _, part in sorted(flown.pop(number).items(), key=lambda item: item[0])]
            scores = Scores.join([part for part, _ in parts])
            thinking = sum(seconds * len(part.lost) for part, seconds in parts) / len(scores.lost)
            yield number, scores, thinking


def batches(episodes: int, most: int, workers: int = 1) -> list[tuple[int, int]]:
    """First episode and number of episodes of batches of about one size, as many for each worker."""
    size = math.ceil(episodes / (workers * math.ceil(episodes / (workers * most))))
    return [(first, min(size, episodes - first)) for first in range(0, episodes, size)]


def fly_batch(scenario: Scenario, policy: Policy, seed: int, first: int, count: int) -> tuple[Scores, float]:
    """The scores of ``count`` episodes of a :class:`Flight` from its ``first`` on, and the seconds per decision."""
    if first:
        # Worlds and what was compiled for them hold each other: those of earlier batches would stay for long.
        gc.collect()
    recorders, thinking = watch(Recorder, scenario, policy, count, seed, first)
    return Scores.join([recorder.scores() for recorder in recorders]), thinking


def watch(
    watcher: Callable[[Simulation], Watcher],
    scenario: Scenario,
    policy: Policy,
    episodes: int,
    seed: int,
    first: int = 0,
) -> tuple[list[Watcher], float]:
    """Fly full episodes at once, seeds ``seed + first …``, those of a :class:`Flight`.

    Args:
        watcher: makes what watches a tile of the batch from the first look on, such as a :class:`Recorder`.
        scenario: as of a flight.
        policy: as of a flight.
        episodes: how many.
        seed: as of a flight.
        first: how many episodes of the flight come before these.

    Returns:
        The watchers, in the order of the episodes, and the seconds per decision that the policy took.
    """
    flown, thinking = scenario.override({**policy.overrides, "episode.early_end": False}), 0.0
    env = LocalisationVectorEnv(episodes, flown, autoreset_mode=AutoresetMode.DISABLED)
    observation, _ = env.reset(seed=seed + first)
    watchers = [watcher(tile) for tile in env.batch.tiles]
    decisions = flown.episode.steps // flown.episode.decision_every
    for decision in range(decisions):
        rng = policy_generator(seed, decision, first * flown.action_size)
        begun = time.perf_counter()
        actions = decide(policy, env, observation, rng)
        thinking += time.perf_counter() - begun
        observation, *_ = env.step(actions)
    return watchers, thinking / (decisions * episodes)


def decide(policy: Policy, env: LocalisationVectorEnv, observation: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The policy's actions ``(N, a)``; nobody but a policy that says it knows the truth is handed it."""
    if not isinstance(policy, TruthKnowing):
        return policy.act(observation, env.belief, rng)
    models = [tile.models for tile in env.batch.tiles]
    truth = [
        model.tracker.layout.convert(tile.truth, model.truth.layout)
        for model, tile in zip(models, env.batch.tiles, strict=True)
    ]
    return policy.act_on_truth(np.concatenate(truth, axis=-1), observation, env.belief, rng)


def policy_generator(seed: int, decision: int, skip: int) -> np.random.Generator:
    """The policy's random numbers at one decision, beyond those of earlier episodes.

    A policy that draws one uniform number per action component then does the same in each episode however the episodes
    are batched.
    """
    bits = np.random.PCG64(np.random.SeedSequence((seed, decision)))
    bits.advance(skip)
    return np.random.Generator(bits)
