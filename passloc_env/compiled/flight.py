"""Flying a simulation by its plan: the same numbers as its own methods, in a fraction of the time."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from passloc_env.compiled.machine import Run
from passloc_env.compiled.plan import Plan
from passloc_env.compiled.section import Section, Workspace
from passloc_env.compiled.stage import COLUMN, FIRST, Slot, episode_arrays, live_arrays

_TOGETHER = 512
"""Environments of a section at most: the rows that it needs take less than the cache of a processor's core holds."""


class Flight:
    """A batch of environments, flown section by section.

    Attributes:
        repeated: how often a section's sensor step had to be done by the simulation's own methods.
    """

    def __init__(self, plan: Plan, simulation: Any) -> None:
        self._simulation, self.repeated = simulation, 0
        environments = simulation.environments
        self._action = simulation.action.copy()
        results = _results(plan, environments)
        self._detected, self._features = results.get("result.detected"), results["result.observation"]
        live = live_arrays(simulation)
        given = {"argument.action": self._action, FIRST[0]: simulation.noise.first_cells}
        rows = _rows({**live, **results, **given, **episode_arrays(simulation.noise)})

        count = -(-environments // _TOGETHER)
        edges = [environments * index // count for index in range(count + 1)]
        written = {slot: live[slot[0]].dtype for slot in plan.stages["sense"].outputs if slot[0] in live}
        largest = -(-environments // count)
        self._columns = np.zeros(largest, np.int64)
        workspace = Workspace(plan, largest, written)
        noise = _noise_rows(simulation.noise)
        self._open = self._opening(plan, rows | noise, workspace)
        self._sections = []
        for first, last in pairwise(edges):
            own = {slot: row[first:last] for slot, row in rows.items()} | noise
            self._sections.append(Section(plan, simulation, slice(first, last), own, workspace))

    def _opening(self, plan: Plan, rows: dict[Slot, np.ndarray], workspace: Workspace) -> Run | None:
        """What begins new episodes, in so many environments at once as a section has; None where methods must."""
        if "open" not in plan.machines:
            return None
        here = {**rows, COLUMN: self._columns}
        return plan.machines["open"](here, here, workspace.scratch(len(self._columns)))

    def open(self, columns: np.ndarray) -> bool:
        """Begin new episodes in some environments; false where the simulation's own methods must."""
        if self._open is None:
            return False
        met = True
        for first in range(0, len(columns), len(self._columns)):
            some = columns[first : first + len(self._columns)]
            self._columns[: len(some)] = some
            met &= self._open(len(some))
        return met

    def step(self, action: np.ndarray) -> None:
        """One decision."""
        simulation, steps = self._simulation, self._simulation.scenario.episode.decision_every
        self._action[...] = action
        if simulation.watchers:
            for section in self._sections:
                section.decide()
            for _ in range(steps):
                self._sense_together()
            for section in self._sections:
                section.conclude()
            return
        for section in self._sections:
            section.decide()
            for _ in range(steps):
                self.repeated += not section.sense()
            section.land()
            section.conclude()
        self._show()

    def _sense_together(self) -> None:
        """One sensor step of all, and whoever watches it."""
        for section in self._sections:
            self.repeated += not section.sense()
            section.land()
        self._show()
        self._simulation.tell()

    def _show(self) -> None:
        """Let the simulation tell what the last sensor step came to."""
        self._simulation.outcome, detected = None, self._detected
        for section in self._sections:
            if section.detected is not None:
                if detected is None:
                    detected = np.ones((len(section.detected), self._simulation.environments), bool)
                detected[:, section.part] = section.detected
        self._simulation.detected = detected

    def observe(self) -> np.ndarray:
        """The observation features ``(f, N)``; a new array."""
        for section in self._sections:
            section.observe()
        return self._features.copy()


def _rows(arrays: dict[str, np.ndarray]) -> dict[Slot, np.ndarray]:
    """Every row of arrays ``(…, N)``, in C order."""
    return {
        (name, index): row
        for name, array in arrays.items()
        for index, row in enumerate(array.reshape(-1, array.shape[-1]))
    }


def _noise_rows(noise: Any) -> dict[Slot, np.ndarray]:
    """Where the noise of a step begins in what is kept of whole episodes."""
    return {
        (f"step.{kind}", index): table.numbers[index:]
        for kind, table in noise.tables().items()
        for index in range(table.pitch)
    }


def _results(plan: Plan, environments: int) -> dict[str, np.ndarray]:
    """New arrays for what stages return, by name."""
    slots = [slot for stage in plan.stages.values() for slot in stage.outputs if slot[0].startswith("result.")]
    sizes = {name: 1 + max(index for other, index in slots if other == name) for name, _ in slots}
    kinds = {"result.detected": bool}
    return {name: np.empty((size, environments), kinds.get(name, float)) for name, size in sizes.items()}
