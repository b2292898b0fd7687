"""A batch of environments of any size, run as tiles that fit the processor's cache.

Every environment is independent of its neighbours to the last bit, so cutting the batch into tiles changes nothing but
the speed. What comes out is batch axis *first*, as Gymnasium wants it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding

from passloc_env.arrays import Array, BoolArray
from passloc_env.belief import Belief
from passloc_env.randomisation import join
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation

TILE = 4096
"""Environments per tile: larger tiles fall out of the caches, smaller ones pay NumPy's call overhead."""

# A large block, allocated and freed, teaches glibc's allocator to keep the temporaries of a tile (up to 1.2 MB) on its
# heap: its thresholds follow the largest block ever freed. Otherwise each one would be mapped, faulted in page by page
# and unmapped again, which halves the speed. The block itself is never touched, so it costs nothing.
np.empty(31 << 20, np.uint8)


class Verdict(NamedTuple):
    """What the last decision of every environment came to, ``(N,)`` each; new arrays."""

    reward: Array
    terminated: BoolArray
    truncated: BoolArray


class Round(NamedTuple):
    """One call of the vector interface: what it hands out, ``(N, …)``.

    ``last`` holds observations and info from before the resets of this very round; None where there were none.
    """

    observation: np.ndarray
    verdict: Verdict
    info: dict[str, Any]
    last: tuple[np.ndarray, dict[str, Any]] | None


class Batch:
    """Environments ``0 … size − 1`` of one scenario, each with a random generator of its own."""

    def __init__(self, scenario: Scenario, size: int, tile: int = TILE) -> None:
        self.scenario, self.size = scenario, size
        starts = range(0, size, tile)
        self.slices = [slice(first, min(first + tile, size)) for first in starts]
        self.tiles = [Simulation(scenario, part.stop - part.start) for part in self.slices]
        self.generators: list[np.random.Generator | None] = [None] * size

    def seed(self, index: int, seed: int | None) -> None:
        """Give one environment a new generator, or its first one when ``seed`` is None."""
        if seed is not None or self.generators[index] is None:
            self.generators[index] = seeding.np_random(seed)[0]

    def seed_all(self, mask: BoolArray, seeds: list[int | None]) -> None:
        """The same for every environment of a mask ``(N,)``."""
        for index in np.flatnonzero(mask):
            self.seed(int(index), seeds[index])

    def reset(self, mask: BoolArray) -> None:
        """Begin new episodes where ``mask (N,)``; every such environment has been seeded before."""
        for part, tile in zip(self.slices, self.tiles, strict=True):
            columns = np.flatnonzero(mask[part])
            generators = [self.generators[part.start + int(column)] for column in columns]
            tile.reset(columns, generators)  # type: ignore[arg-type]

    def step(self, actions: Array) -> None:
        """One decision of every environment, ``actions (N, a)`` finite."""
        turned = np.ascontiguousarray(actions.T)
        for part, tile in zip(self.slices, self.tiles, strict=True):
            tile.step(turned[:, part])

    def gather(self, pick: Callable[[Simulation], np.ndarray]) -> np.ndarray:
        """Concatenate ``(…, n)`` arrays of the tiles to a fresh ``(N, …)``."""
        parts = [pick(tile) for tile in self.tiles]
        joined = parts[0].copy() if len(parts) == 1 else np.concatenate(parts, axis=-1)
        return joined if joined.ndim == 1 else np.ascontiguousarray(np.moveaxis(joined, -1, 0))

    def fly(self, actions: Array, resetting: BoolArray, same_step: bool, diagnostics: bool) -> Round:
        """One decision, or a new episode where ``resetting (N,)``; with ``same_step`` also where one has just ended."""
        if not resetting.all():
            self.step(actions)
        verdict = self.verdict()
        if resetting.any():
            self.reset(resetting)
            for values in verdict:
                values[resetting] = 0
        ended, last = verdict.terminated | verdict.truncated, None
        if same_step and ended.any():
            last = self.observe(), self.info(diagnostics)
            self.reset(ended)
        return Round(self.observe(), verdict, self.info(diagnostics), last)

    def verdict(self) -> Verdict:
        """What the last decision came to."""
        return Verdict(
            self.gather(lambda tile: tile.reward),
            self.gather(lambda tile: tile.terminated),
            self.gather(lambda tile: tile.truncated),
        )

    def observe(self) -> np.ndarray:
        """Observations ``(N, f)``, float32."""
        observed = [tile.observe() for tile in self.tiles]
        observation = np.empty((self.size, len(observed[0])), np.float32)
        for part, features in zip(self.slices, observed, strict=True):
            observation[part] = features.T
        return observation

    def info(self, diagnostics: bool) -> dict[str, Any]:
        """Named reward terms and the violation flag; with ``diagnostics`` what only the world knows as well."""
        info: dict[str, Any] = {
            "reward_terms": {
                term.name: self.gather(lambda tile, name=term.name: tile.reward_terms[name])  # type: ignore[misc]
                for term in self.scenario.reward
            },
            "violated": self.gather(lambda tile: tile.violated),
        }
        if diagnostics:
            # Some environments may never have been reset; their diagnostics mean nothing and are masked by the caller.
            with np.errstate(all="ignore"):
                info |= {name: self.gather(pick) for name, pick in _DIAGNOSTICS.items()}
        return info

    @property
    def belief(self) -> Belief:
        """What policies may know, of all environments."""
        beliefs = [tile.belief for tile in self.tiles]
        return beliefs[0] if len(beliefs) == 1 else join_beliefs(beliefs)

    def get_arrays(self) -> dict[str, np.ndarray]:
        """A copy of the state, batch axis last, by name."""
        tiles = [tile.state_arrays() for tile in self.tiles]
        return {name: np.concatenate([arrays[name] for arrays in tiles], axis=-1) for name in tiles[0]}

    def get_generators(self) -> list[Any]:
        """The state of every environment's generator; None where there is none yet."""
        return [None if generator is None else generator.bit_generator.state for generator in self.generators]

    def set_generators(self, states: list[Any]) -> None:
        """Put them back."""
        self.generators = [None if state is None else _generator(state) for state in states]

    def check_arrays(self, arrays: dict[str, np.ndarray]) -> None:
        """ValueError when a state from :meth:`get_arrays` does not fit."""
        for name, live in self.get_arrays().items():
            if name not in arrays or arrays[name].shape != live.shape:
                found = arrays[name].shape if name in arrays else "nothing"
                raise ValueError(f"the state does not fit this environment: {name} is {found}, expected {live.shape}")
        counts, steps = arrays[_COUNT], self.tiles[0].scenario.episode.steps
        # The noise of a step is looked up by its count.
        if ((counts < 0) | (counts > steps)).any():
            raise ValueError(f"the state does not fit this environment: {_COUNT} must be from 0 to {steps}")

    def set_arrays(self, arrays: dict[str, np.ndarray]) -> None:
        """Put a state from :meth:`get_arrays` back; ValueError, with nothing changed, when it does not fit."""
        self.check_arrays(arrays)
        self.put_arrays(arrays)

    def put_arrays(self, arrays: dict[str, np.ndarray]) -> None:
        """The same for a state that is known to fit."""
        for part, tile in zip(self.slices, self.tiles, strict=True):
            tile.restore({name: values[..., part] for name, values in arrays.items()})


def _generator(state: Any) -> np.random.Generator:
    bits = np.random.PCG64()
    bits.state = state
    return np.random.Generator(bits)


_COUNT = "simulation.step_count"

_DIAGNOSTICS: dict[str, Callable[[Simulation], np.ndarray]] = {
    "truth": lambda tile: tile.truth,
    "estimate": lambda tile: tile.track.mean,
    "covariance": lambda tile: tile.track.covariance,
    "nees": lambda tile: tile.outcome.nees,
    "relative_range_error": lambda tile: tile.outcome.relative_range_error,
    "bound": lambda tile: tile.outcome.range_sigma,
    "range": lambda tile: tile.outcome.range,
    "repairs": lambda tile: tile.track.repairs,
    "gated": lambda tile: tile.track.gated,
}


def join_beliefs(beliefs: list[Belief]) -> Belief:
    """The belief of several batches put end to end."""
    first = beliefs[0]

    def together(name: str) -> Array:
        return np.concatenate([getattr(belief, name) for belief in beliefs], axis=-1)

    return Belief(
        time=together("time"),
        time_left=together("time_left"),
        interval=first.interval,
        period=first.period,
        mean=together("mean"),
        covariance=together("covariance"),
        layout=first.layout,
        poses=[poses[0].join(list(poses)) for poses in zip(*(belief.poses for belief in beliefs), strict=True)],
        platforms=tuple(join(list(parts)) for parts in zip(*(belief.platforms for belief in beliefs), strict=True)),
        sensors=tuple(join(list(parts)) for parts in zip(*(belief.sensors for belief in beliefs), strict=True)),
        motion=join([belief.motion for belief in beliefs]),
        own_ship=first.own_ship,
        min_range=first.min_range,
        last_action=together("last_action"),
        components={
            name: np.concatenate([belief.components[name] for belief in beliefs], axis=-1) for name in first.components
        },
    )
