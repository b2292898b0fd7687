"""Planners: manoeuvres chosen by looking ahead from the belief, and by nothing else.

A greedy planner looks one decision ahead; a receding-horizon planner plans some legs over a horizon, flies the
beginning of the first, and plans anew at the next decision. Decisions are functions of the belief alone: there is no
memory, and the samples of the search are fixed, the same for all environments and decisions, so that the random numbers
handed to a policy are not touched. An environment's decision is the same to the last bit in a batch of any size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from agents.criterion import Criterion
from agents.forecast import Forecast, Pace, Situation
from agents.search import Cost, coordinate_search, cross_entropy
from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.belief import Belief
from passloc_env.errors import InputError
from passloc_env.platforms import Platform, TurnLimitedPlatform

_COLUMNS = 8192
"""Candidates flown in one pass: more fall out of the processor's caches."""

_SAMPLES_SEED = 20240229


@dataclass(frozen=True)
class Planner:
    """Base of policies that look ahead.

    Args:
        name: how tables call it.
        criterion: what makes a plan good.
        seconds: how far it looks ahead; infinite for the end of the episode. At least one decision, and never past the
            end.
        looks: looks at the forecast geometry, about; measurements in between count as made at the next one.
    """

    name: str = "planner"
    criterion: Criterion = Criterion()
    seconds: float = 0.0
    looks: int = 12
    overrides: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @property
    def candidates(self) -> int:
        """The most plans that are flown at once for one environment."""
        raise AssertionError(f"{type(self).__name__} must define candidates")

    def search(self, cost: Cost, situation: Situation, start: Array) -> Array:
        """The best plan ``(legs · a, N)``; ``start (a, N)`` is the action in force."""
        raise AssertionError(f"{type(self).__name__} must define search")

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """The first action ``(N, a)`` of the best plan."""
        return self.plan(belief)

    def plan(self, belief: Belief, emitter: Array | None = None) -> np.ndarray:
        """The first action ``(N, a)`` of the best plan from the belief's mean, or from ``emitter (n, N)``."""
        with np.errstate(all="ignore"):
            situation = Situation.of(belief, emitter)
            actions = np.empty((situation.controls, len(belief.time)))
            ahead = self._steps_ahead(belief, situation.every)
            at_once = max(1, _COLUMNS // self.candidates)
            for steps in np.unique(ahead):
                pace = Pace.of(int(steps), self.looks, situation.every)
                alike = np.flatnonzero(ahead == steps)
                for first in range(0, len(alike), at_once):
                    columns = alike[first : first + at_once]
                    actions[:, columns] = self._plan(belief, situation, columns, pace)
        return actions.T

    def _steps_ahead(self, belief: Belief, every: int) -> IntArray:
        """Sensor steps to look ahead ``(N,)``, whole decisions."""
        left = np.rint(belief.time_left / belief.interval)
        decisions = np.minimum(np.maximum(np.rint(self.seconds / belief.interval), 1.0), left)
        return every * np.maximum(decisions, 1.0).astype(np.int64)

    def _plan(self, belief: Belief, situation: Situation, columns: IntArray, pace: Pace) -> Array:
        """The first actions ``(a, n)`` of some environments."""
        commanded = tuple(i for i, platform in enumerate(belief.platforms) if platform.controls)
        forecasts: dict[int, Forecast] = {}

        def cost(plans: Array) -> Array:
            candidates, count = plans.shape[1:]
            if candidates not in forecasts:
                forecasts[candidates] = Forecast(situation.take(np.tile(columns, candidates)), pace)
            legs = plans.reshape(-1, situation.controls, candidates * count)
            costs = self.criterion.cost(forecasts[candidates].fly(legs), commanded, belief.min_range)
            return costs.reshape(candidates, count)

        return self.search(cost, situation, belief.last_action[:, columns])[: situation.controls]


@dataclass(frozen=True)
class Greedy(Planner):
    """The best of a grid of actions for one decision; several platforms take turns.

    Args:
        grid: actions compared per component: headings all around, or rates from end to end.
        sweeps: turns of every component where there are several.
    """

    name: str = "greedy"
    looks: int = 4
    grid: int = 24
    sweeps: int = 2

    @property
    def candidates(self) -> int:
        """The grid."""
        return self.grid

    def search(self, cost: Cost, situation: Situation, start: Array) -> Array:
        """Every value of the grid, component by component."""
        grid = np.stack([_grid(around, self.grid) for around in _periodic(situation.platforms)])
        return coordinate_search(cost, grid, start, self.sweeps)


@dataclass(frozen=True)
class Horizon(Planner):
    """The best plan of a few legs that a cross-entropy search finds.

    Args:
        legs: actions of a plan, each held for the same time.
        constant: plans of the first generation that hold one action throughout, on a grid.
        sampled: further plans of the first generation, uniformly spread.
        generations: later generations.
        brood: plans in each of them.
        elites: best plans that found the next generation.
    """

    name: str = "horizon"
    seconds: float = 48.0
    looks: int = 8
    legs: int = 4
    constant: int = 12
    sampled: int = 12
    generations: int = 1
    brood: int = 24
    elites: int = 6

    @property
    def candidates(self) -> int:
        """The largest generation."""
        return max(self.constant + self.sampled, self.brood)

    def search(self, cost: Cost, situation: Situation, start: Array) -> Array:
        """Constant plans and uniform ones, then generations ever closer to the best."""
        controls = situation.controls
        first, later = self._samples(controls)
        periodic = np.tile(_periodic(situation.platforms), self.legs)
        grid = np.stack([_grid(around, self.constant) for around in periodic])
        population = np.concatenate([grid, first], axis=1)[..., None]
        return cross_entropy(cost, np.repeat(population, start.shape[1], axis=2), later, self.elites, periodic)

    def _samples(self, controls: int) -> tuple[Array, Array]:
        """Uniform plans ``(C, sampled)`` and normals ``(generations, C, brood)``, in pairs of opposite sign."""
        rng = np.random.default_rng(_SAMPLES_SEED)
        components = self.legs * controls
        uniform = rng.uniform(-1.0, 1.0, (components, -(-self.sampled // 2)))
        normal = rng.standard_normal((self.generations, components, -(-self.brood // 2)))
        return _mirrored(uniform)[:, : self.sampled], _mirrored(normal)[..., : self.brood]


@dataclass(frozen=True)
class WithTruth:
    """A planner that starts from where the emitter truly is, with the tracker's covariance.

    What it gains over the planner itself is what a better estimate of the state could ever gain it.
    """

    planner: Planner

    @property
    def name(self) -> str:
        """The planner's, with a word of warning."""
        first, *rest = self.planner.name.split(" ")
        return " ".join([f"{first}-truth", *rest])

    @property
    def overrides(self) -> Mapping[str, Any]:
        """Those of the planner."""
        return self.planner.overrides

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """Impossible: no belief holds the truth; InputError."""
        raise InputError(f"policy = {self.name!r} is not possible: nobody here tells it the truth")

    def act_on_truth(
        self, truth: Array, observation: np.ndarray, belief: Belief, rng: np.random.Generator
    ) -> np.ndarray:
        """The first action ``(N, a)`` of the best plan from the true state ``(n, N)``."""
        return self.planner.plan(belief, truth)


def _periodic(platforms: tuple[Platform, ...]) -> BoolArray:
    """Which action components are headings ``(a,)``, so that 1 and -1 are the same."""
    flags = [
        isinstance(platform, TurnLimitedPlatform) and platform.control == "heading"
        for platform in platforms
        for _ in range(platform.controls)
    ]
    return np.array(flags, bool)


def _grid(periodic: bool, count: int) -> Array:
    """Evenly spread actions ``(count,)``, as many to port as to starboard."""
    return np.linspace(-1.0, 1.0, count, endpoint=False) if periodic else np.linspace(-1.0, 1.0, count)


def _mirrored(samples: Array) -> Array:
    """Samples and their opposites, side by side in the last axis."""
    return np.stack([samples, -samples], axis=-1).reshape(*samples.shape[:-1], 2 * samples.shape[-1])
