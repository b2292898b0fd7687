"""Flying a simulation by its plan: the same numbers as its own methods, in a fraction of the time.

A sensor step reads the state from one set of rows and writes it to another, and the sets change places. So nothing is
lost where a guard does not hold: the step is done again by the simulation's own methods.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from passloc_env.compiled.plan import Plan
from passloc_env.compiled.stage import CELL, COLUMN, OPENING, Slot, live_arrays


class Flight:
    """A batch of environments flown on rows; :attr:`repeated` counts the sensor steps done again."""

    def __init__(self, plan: Plan, simulation: Any) -> None:
        self._simulation, self.repeated = simulation, 0
        self._time, self._action = simulation.time, simulation.action.copy()
        self._cell = np.zeros(simulation.environments, np.int64)
        self._columns = np.zeros(simulation.environments, np.int64)
        given = {"argument.time": self._time, "argument.action": self._action}
        given |= {CELL[0]: self._cell, COLUMN[0]: self._columns}
        given |= dict(zip(OPENING, simulation.noise.opening(), strict=False))
        results = _results(plan, simulation.environments)
        self._detected, self._features = results.get("result.detected"), results["result.observation"]
        state = _rows(live_arrays(simulation))
        here = {**state, **_noise_rows(simulation.noise), **_rows(given), **_rows(results)}
        spare = {slot: np.empty_like(state[slot]) for slot in plan.stages["sense"].outputs if slot in state}
        there = {**here, **spare}

        machines = plan.machines
        self._sense = (machines["sense"](here, there), machines["sense"](there, here))
        self._open = machines["open"](here, here) if "open" in machines else None
        self._back = machines["back"](there, here)
        self._decide, self._mirror, self._conclude, self._observe = (
            machines[name](here, here) for name in ("decide", "mirror", "conclude", "observe")
        )

    def open(self, columns: np.ndarray) -> bool:
        """Begin new episodes in some environments; false where the simulation's own methods must."""
        if self._open is None:
            return False
        self._columns[: len(columns)] = columns
        self._simulation.step_count[columns] = 0
        self._look_at_clock()
        return self._open.first(len(columns))

    def step(self, action: np.ndarray) -> None:
        """One decision."""
        simulation = self._simulation
        self._action[...] = action
        self._look_at_clock()
        self._decide()
        there = False
        for _ in range(simulation.scenario.episode.decision_every):
            np.multiply(simulation.step_count, simulation.scenario.episode.period, out=self._time)
            simulation.step_count += 1
            simulation.noise.cells(simulation.step_count, self._cell)
            done = self._sense[there]()
            if done:
                there = not there
                simulation.outcome, simulation.detected = None, self._detected
            if done and not simulation.watchers:
                continue
            self._land(there)
            there = False
            if not done:
                self.repeated += 1
                simulation.sense(self._time.copy(), simulation.noise_at())
            simulation.tell()
        self._land(there)
        self._conclude()

    def _look_at_clock(self) -> None:
        """Let time and noise be those of the present step."""
        np.multiply(self._simulation.step_count, self._simulation.scenario.episode.period, out=self._time)
        self._simulation.noise.cells(self._simulation.step_count, self._cell)

    def _land(self, there: bool) -> None:
        """Bring the state to where everybody looks for it."""
        if there:
            self._back()
        self._mirror()

    def observe(self) -> np.ndarray:
        """The observation features ``(f, N)``; a new array."""
        self._look_at_clock()
        self._observe()
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
    rows = {
        (f"step.{kind}", index): table.numbers[index:]
        for kind, table in noise.tables().items()
        for index in range(table.pitch)
    }
    return rows | _rows({f"step.constant.{platform}": errors for platform, errors in enumerate(noise.constants())})


def _results(plan: Plan, environments: int) -> dict[str, np.ndarray]:
    """New arrays for what stages return, by name."""
    slots = [slot for stage in plan.stages.values() for slot in stage.outputs if slot[0].startswith("result.")]
    sizes = {name: 1 + max(index for other, index in slots if other == name) for name, _ in slots}
    kinds = {"result.detected": bool}
    return {name: np.empty((size, environments), kinds.get(name, float)) for name, size in sizes.items()}
