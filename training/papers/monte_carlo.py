"""Monte Carlo runs of a scenario as the papers report them: histories over time of a whole batch of runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from agents import Policy, find_policy
from passloc_env.arrays import Array
from passloc_env.metrics import lost, root_trace
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from training.engines import ALONE, Engine
from training.episodes import CHUNK, batches, watch
from training.statistics import Bootstrap, Estimate, chi_square_band, root_mean_square

Quantity = Callable[[Simulation], Array]
"""Something to keep from every step: ``(N,)`` from the simulation."""


def position_bound(simulation: Simulation) -> Array:
    """Root of the trace of the bound's position block ``(N,)``, m."""
    position = simulation.information.dynamics.layout.position
    return root_trace(simulation.information.bound, position)


def position_error(simulation: Simulation) -> Array:
    """Distance between estimate and truth ``(N,)``, m."""
    return np.sqrt(np.square(simulation.outcome.position_error).sum(axis=0))


_ALWAYS: dict[str, Quantity] = {
    "error": position_error,
    "bound": position_bound,
    "range": lambda simulation: simulation.outcome.range.copy(),
    "nees": lambda simulation: simulation.outcome.nees,
}


def last_instant(times: Array, time: float) -> int:
    """The last of rising instants ``(K,)`` that is not after a time, s; the first when all are."""
    return max(int(np.searchsorted(times, time + 1e-9, side="right")) - 1, 0)


@dataclass
class History:
    """What happened in a batch of runs.

    Attributes:
        time: of each kept instant ``(K,)``, s.
        error: distance between estimate and truth ``(K, N)``, m.
        bound: root of the trace of the bound on the position ``(K, N)``, m.
        range: true range ``(K, N)``, m.
        nees: normalised estimation error squared ``(K, N)``.
        states: how many states the NEES runs over.
        extra: further quantities by name, ``(K, N)`` each.
    """

    time: Array
    error: Array
    bound: Array
    range: Array
    nees: Array
    states: int
    extra: dict[str, Array] = field(default_factory=dict)

    @property
    def relative_error(self) -> Array:
        """Error over true range ``(K, N)`` (paper 000, eq. 26)."""
        return self.error / self.range

    @property
    def relative_rms(self) -> Array:
        """Root mean square over the runs of the relative error ``(K,)``."""
        return root_mean_square(self.relative_error, axis=1)

    @property
    def relative_bound(self) -> Array:
        """The same of the bound ``(K,)``."""
        return root_mean_square(self.bound / self.range, axis=1)

    def rms(self, name: str = "error") -> Array:
        """Root mean square over the runs of a quantity ``(K,)``."""
        values = self.error if name == "error" else self.extra[name]
        return root_mean_square(values, axis=1)

    @property
    def efficiency(self) -> Array:
        """RMS error over RMS bound ``(K,)``; 1 for an efficient tracker, lost runs included."""
        return self.rms() / root_mean_square(self.bound, axis=1)

    @property
    def anees(self) -> float:
        """Average NEES per state over runs and time; 1 when consistent."""
        return float(self.nees.mean()) / self.states

    @property
    def end_anees(self) -> Estimate:
        """NEES per state at the end, averaged over the runs, with the 95 % band of a consistent tracker."""
        low, high = chi_square_band(self.states * self.nees.shape[1])
        return Estimate(float(self.nees[-1].mean()) / self.states, low, high)

    @property
    def lost(self) -> float:
        """Share of runs that end lost."""
        return float(lost(self.relative_error[-1], self.nees[-1]).mean())

    def at(self, time: float) -> int:
        """The last kept instant not after a time, s."""
        return last_instant(self.time, time)

    def relative_rms_at(self, time: float) -> Estimate:
        """RMS relative error at a time, with its bootstrap interval."""
        return Bootstrap(self.error.shape[1]).estimate(self.relative_error[self.at(time)], root_mean_square)


def run(
    scenario: Scenario,
    runs: int,
    seed: int,
    policy: str | Policy = "stationary",
    every: int = 1,
    extra: Mapping[str, Quantity] | None = None,
    engine: Engine = ALONE,
) -> History:
    """Fly whole episodes of a scenario and keep their histories; nothing ends early.

    Args:
        scenario: the problem.
        runs: how many.
        seed: of the first run; the others count up from it.
        policy: who moves the observer, by default nobody.
        every: keep each so many sensor steps.
        extra: further quantities to keep, functions that a module holds by name.
        engine: where the runs are flown.
    """
    flown_by = find_policy(policy, scenario) if isinstance(policy, str) else policy
    tasks = [
        (scenario, flown_by, seed, first, count, every, dict(extra or {}))
        for first, count in batches(runs, CHUNK, engine.workers)
    ]
    parts = [part for _, part in sorted(engine.map(_fly, tasks), key=lambda numbered: numbered[0])]
    joined = {name: np.concatenate([part.kept[name] for part in parts], axis=1) for name in (*_ALWAYS, *(extra or {}))}
    return History(
        time=parts[0].time,
        states=parts[0].states,
        extra={name: joined[name] for name in extra or {}},
        **{name: joined[name] for name in _ALWAYS},
    )


class _Part(NamedTuple):
    """What some of the runs came to: the instants ``(K,)``, s, the shared states, the quantities ``(K, n)``."""

    time: Array
    states: int
    kept: dict[str, Array]


def _fly(
    scenario: Scenario,
    policy: Policy,
    seed: int,
    first: int,
    count: int,
    every: int,
    extra: Mapping[str, Quantity],
) -> _Part:
    """Runs ``first …`` of those that begin with ``seed``."""
    quantities = {**_ALWAYS, **extra}
    keepers, _ = watch(partial(_Keeper, quantities, every), scenario, policy, count, seed, first)
    kept = {name: np.concatenate([np.stack(keeper.kept[name]) for keeper in keepers], axis=1) for name in quantities}
    return _Part(np.array(keepers[0].time), keepers[0].states, kept)


class _Keeper:
    """Keeps what there is to keep after a sensor step of one tile of the batch."""

    def __init__(self, quantities: Mapping[str, Quantity], every: int, simulation: Simulation) -> None:
        self._quantities, self._every = quantities, every
        self.time: list[float] = []
        self.kept: dict[str, list[Array]] = {name: [] for name in quantities}
        models = simulation.models
        self.states = len(models.tracker.layout.shared_rows(models.truth.layout))
        simulation.watchers.append(self._keep)

    def _keep(self, simulation: Simulation) -> None:
        if simulation.step_count[0] % self._every == 0:
            self.time.append(simulation.time[0])
            for name, quantity in self._quantities.items():
                self.kept[name].append(quantity(simulation))
