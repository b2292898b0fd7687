"""The random numbers of an episode, drawn once at reset.

Each environment has a generator of its own. A reset takes a block of keys from it and draws everything else from
streams under those keys, one per kind of noise, in fixed order and size. So neither the batch around an environment,
nor another kind of noise being switched on, nor the length of earlier episodes ever changes what it meets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from passloc_env.arrays import Array, IntArray

_KINDS = 8
_QUANTITIES, _PRIOR, _NUISANCES, _MEASUREMENT, _PROCESS, _DETECTION, _NAVIGATION, _UNIFORM = range(_KINDS)
_FAULT = _KINDS + _DETECTION
"""A kind beyond these has the keys of the one so many before it, and draws from far ahead in that stream."""

_FAR = 1 << 96


@dataclass(frozen=True)
class NoiseSizes:
    """How many numbers an episode needs.

    Attributes:
        uniforms: for the scenario's quantities.
        prior: normals for the prior.
        nuisances: true nuisance states.
        steps: sensor steps.
        measurement: scalars per measurement.
        process: process noises per step.
        detection: sensors that may miss; 0 when none does.
        fault: draws per step that decide what goes wrong; 0 when nothing does.
        navigation: errors that each platform needs, for a whole episode and at each instant.
        uniform: which scalars of a measurement have uniform errors.
    """

    uniforms: int
    prior: int
    nuisances: int
    steps: int
    measurement: int
    process: int
    detection: int
    navigation: tuple[tuple[int, int], ...] = ()
    uniform: tuple[int, ...] = ()
    fault: int = 0


class NavigationErrors(NamedTuple):
    """Standard normals that a platform turns into the errors of what it believes about itself."""

    constant: Array
    """The same throughout an episode, ``(c, N)``."""
    fresh: Array
    """Anew at each instant, ``(f, N)``."""


class StepNoise(NamedTuple):
    """What chance does to one sensor step of every environment."""

    measurement: Array
    """Errors ``(m, N)`` of the measurement, uncorrelated, of unit variance."""
    process: Array
    """Standard normals ``(w, N)`` that disturb the emitter on its way there."""
    detection: Array
    """Standard uniforms ``(s, N)`` that decide what is detected."""
    fault: Array
    """Standard uniforms ``(2s, N)`` that decide which errors are outliers, and what comes late; 1 at the first look."""
    navigation: list[NavigationErrors]
    """The navigation errors of each platform."""


class Opening(NamedTuple):
    """What chance has in store for the beginning of episodes."""

    uniforms: Array
    """Standard uniforms for the scenario's quantities ``(q, k)``."""
    prior: Array
    """Standard normals for the prior ``(p, k)``."""
    nuisances: Array
    """Standard normals for the true nuisance states ``(u, k)``."""
    first: StepNoise
    """The noise of the first look."""


class StepTable(NamedTuple):
    """The noise of a kind at every step: number ``i`` of cell ``c`` is at ``c · pitch + i``."""

    numbers: Array
    pitch: int


class EpisodeNoise:
    """The noise of a batch of episodes. Measurement noise ``k`` belongs to time ``k``; 0 is the first look.

    Attributes:
        uniforms, prior, nuisances: see :class:`Opening`, of all environments.
        first_cells: where each environment's steps begin among all, for :meth:`tables`; step ``k`` is ``k`` further.
    """

    def __init__(self, sizes: NoiseSizes, environments: int) -> None:
        self._sizes = sizes
        self.uniforms: Array = np.zeros((sizes.uniforms, environments))
        self.prior: Array = np.zeros((sizes.prior, environments))
        self.nuisances: Array = np.zeros((sizes.nuisances, environments))
        self._measurement: Array = np.zeros((environments, sizes.steps + 1, sizes.measurement))
        self._process: Array = np.zeros((environments, sizes.steps + 1, sizes.process))
        self._detection: Array = np.zeros((environments, sizes.steps + 1, sizes.detection))
        self._fault: Array = np.ones((environments, sizes.steps + 1, sizes.fault))
        constant = sum(kept for kept, _ in sizes.navigation)
        fresh = sum(renewed for _, renewed in sizes.navigation)
        self._constant_errors: Array = np.zeros((constant, environments))
        self._fresh_errors: Array = np.zeros((environments, sizes.steps + 1, fresh))
        self._uniform = list(sizes.uniform)
        self._rows = np.arange(environments)
        self.first_cells = self._rows * (sizes.steps + 1)
        self._bits = np.random.PCG64(0)
        self._generator = np.random.Generator(self._bits)
        self._words = {"state": 0, "inc": 1}
        self._state: Any = {"bit_generator": "PCG64", "state": self._words, "has_uint32": 0, "uinteger": 0}

    def draw(self, column: int, generator: np.random.Generator) -> None:
        """Draw a whole episode for one environment; takes one block of words from its generator."""
        keys = _words(generator, 4 * _KINDS).tolist()
        self.uniforms[:, column] = self._stream(keys, _QUANTITIES).random(self._sizes.uniforms)
        if self._sizes.prior:
            self.prior[:, column] = self._stream(keys, _PRIOR).standard_normal(self._sizes.prior)
        if self._sizes.nuisances:
            self.nuisances[:, column] = self._stream(keys, _NUISANCES).standard_normal(self._sizes.nuisances)
        self._stream(keys, _MEASUREMENT).standard_normal(out=self._measurement[column])
        if self._uniform:
            uniforms = self._stream(keys, _UNIFORM).random((self._sizes.steps + 1, len(self._uniform)))
            self._measurement[column][:, self._uniform] = math.sqrt(12.0) * (uniforms - 0.5)
        if self._sizes.process:
            self._stream(keys, _PROCESS).standard_normal(out=self._process[column, 1:])
        if self._sizes.detection:
            self._stream(keys, _DETECTION).random(out=self._detection[column])
        if self._sizes.fault:
            self._stream(keys, _FAULT).random(out=self._fault[column, 1:])

        if len(self._constant_errors) or self._fresh_errors.shape[-1]:
            stream = self._stream(keys, _NAVIGATION)
            self._constant_errors[:, column] = stream.standard_normal(len(self._constant_errors))
            stream.standard_normal(out=self._fresh_errors[column])

    def _stream(self, keys: list[int], kind: int) -> np.random.Generator:
        """The stream of a kind of noise: one generator, set anew, for building one costs more than its draws."""
        further, kind = divmod(kind, _KINDS)
        high, low, odd, even = keys[4 * kind : 4 * kind + 4]
        self._words["state"], self._words["inc"] = high << 64 | low, odd << 64 | even | 1
        self._bits.state = self._state
        if further:
            self._bits.advance(further * _FAR)
        return self._generator

    def at(self, step: IntArray, columns: IntArray | slice = slice(None)) -> StepNoise:
        """All that belongs to the step that ends at measurement ``step (N,)``, in some environments."""
        return StepNoise(
            self.measurement(step, columns),
            self.process(step, columns),
            self.detection(step, columns),
            self._taken(self._fault, step, columns),
            self.navigation(step, columns),
        )

    def opening(self, columns: IntArray | slice = slice(None)) -> Opening:
        """All that belongs to the beginning of an episode, in some environments."""
        first = self.at(np.zeros(len(self._rows), np.int64), columns)
        return Opening(self.uniforms[:, columns], self.prior[:, columns], self.nuisances[:, columns], first)

    def tables(self) -> dict[str, StepTable]:
        """Where :meth:`at` finds what is new at every step, by kind; of the navigation errors, by platform."""
        every = {"measurement": self._measurement, "process": self._process}
        every |= {"detection": self._detection, "fault": self._fault}
        tables = {kind: StepTable(array.reshape(-1), array.shape[-1]) for kind, array in every.items()}
        fresh, first = self._fresh_errors.reshape(-1), 0
        for platform, (_, renewed) in enumerate(self._sizes.navigation):
            tables[f"fresh.{platform}"] = StepTable(fresh[first:], self._fresh_errors.shape[-1])
            first += renewed
        return tables

    def measurement(self, step: IntArray, columns: IntArray | slice = slice(None)) -> Array:
        """Errors ``(m, k)`` of the measurement at step ``(N,)``, in some environments; uncorrelated, unit variance."""
        return self._taken(self._measurement, step, columns)

    def process(self, step: IntArray, columns: IntArray | slice = slice(None)) -> Array:
        """Standard normals ``(w, N)`` that disturb the emitter on its way to step ``(N,)``; none lead to step 0."""
        return self._taken(self._process, step, columns)

    def detection(self, step: IntArray, columns: IntArray | slice = slice(None)) -> Array:
        """Standard uniforms ``(s, N)`` that decide what is detected at step ``(N,)``."""
        return self._taken(self._detection, step, columns)

    def navigation(self, step: IntArray, columns: IntArray | slice = slice(None)) -> list[NavigationErrors]:
        """The navigation errors of each platform at step ``(N,)``, in some environments."""
        fresh = self._taken(self._fresh_errors, step, columns)
        errors, first = [], 0
        for constant, (_, renewed) in zip(self.constants(), self._sizes.navigation, strict=True):
            errors.append(NavigationErrors(constant[:, columns], fresh[first : first + renewed]))
            first += renewed
        return errors

    def constants(self) -> list[Array]:
        """What is the same throughout an episode of each platform's navigation errors, ``(c, N)`` each; live."""
        lasts = np.cumsum([kept for kept, _ in self._sizes.navigation]).tolist()
        return [
            self._constant_errors[last - kept : last]
            for last, (kept, _) in zip(lasts, self._sizes.navigation, strict=True)
        ]

    def _taken(self, kept: Array, step: IntArray, columns: IntArray | slice) -> Array:
        """Those ``(k, N)`` of all steps ``(N, steps, k)`` that belong to one step ``(N,)`` of each environment."""
        environments, steps, numbers = kept.shape
        where = step[columns] + (steps * self._rows)[columns]
        return kept.reshape(environments * steps, numbers).take(where, axis=0).T

    def state_arrays(self) -> dict[str, np.ndarray]:
        """All numbers, by kind, batch axis last."""
        return {
            "uniforms": self.uniforms,
            "prior": self.prior,
            "nuisances": self.nuisances,
            "measurement": np.moveaxis(self._measurement, 0, -1),
            "process": np.moveaxis(self._process[:, 1:], 0, -1),
            "detection": np.moveaxis(self._detection, 0, -1),
            "fault": np.moveaxis(self._fault[:, 1:], 0, -1),
            "constant_errors": self._constant_errors,
            "fresh_errors": np.moveaxis(self._fresh_errors, 0, -1),
        }


def _words(generator: np.random.Generator, count: int) -> np.ndarray[tuple[int], np.dtype[np.uint64]]:
    """So many random words; from a PCG64 its own, which ``integers`` would hand on unchanged at twice the cost."""
    if isinstance(generator.bit_generator, np.random.PCG64):
        return generator.bit_generator.random_raw(count)
    return generator.integers(2**64, size=count, dtype=np.uint64)
