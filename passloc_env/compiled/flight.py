"""Flying a simulation by its plan: the same numbers as its own methods, in a fraction of the time.

A sensor step reads the state from one set of rows and writes it to another, and the sets change places. So nothing is
lost where a guard does not hold: the step is done again by the simulation's own methods.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from passloc_env.compiled.plan import Plan
from passloc_env.compiled.stage import Slot, live_arrays, noise_arrays


class RowsFlight:
    """A batch of environments flown on rows; :attr:`repeated` counts the sensor steps done again."""

    def __init__(self, plan: Plan, simulation: Any) -> None:
        self._plan, self._simulation, self.repeated = plan, simulation, 0
        self._noisy = {
            name for name, stage in plan.stages.items() if any(owner.startswith("step.") for owner, _ in stage.inputs)
        }
        live = live_arrays(simulation)
        self._noise = {key: np.array(array, order="C") for key, array in noise_arrays(simulation.noise_at()).items()}
        self._time, self._action = simulation.time, simulation.action.copy()
        given = {**self._noise, "argument.time": self._time, "argument.action": self._action}
        results = _results(plan, simulation.environments)
        self._detected, self._features = results.get("result.detected"), results["result.observation"]
        state = _rows(live)
        here = {**state, **_rows(given), **_rows(results)}
        spare = {slot: np.empty_like(state[slot]) for slot in plan.rows["sense"].outputs if slot in state}
        there = {**here, **spare}
        self._back = [(here[slot], row) for slot, row in spare.items()]
        self._mirror = [(here[above], here[below]) for above, below in plan.mirrored.items() if below in spare]

        sense, observe = plan.rows["sense"], plan.rows["observe"]
        scratch = sense.scratch(simulation.environments)
        self._sense = (sense(here, there, scratch), sense(there, here, scratch))
        self._decide, self._conclude = (self._in_place(name, here) for name in ("decide", "conclude"))
        self._observe = observe(here, here, observe.scratch(simulation.environments))

    def _in_place(self, name: str, here: dict[Slot, np.ndarray]) -> Any:
        """A stage that writes where it reads."""
        rows = self._plan.rows[name]
        new = {slot: np.empty_like(here[slot]) for slot in rows.outputs}
        run = rows(here, new, rows.scratch(self._simulation.environments))

        def bound() -> None:
            run()
            for slot, row in new.items():
                here[slot][...] = row

        return bound

    def step(self, action: np.ndarray) -> None:
        """One decision."""
        simulation = self._simulation
        self._action[...] = action
        self._load_noise("decide")
        self._decide()
        there = False
        for _ in range(simulation.scenario.episode.decision_every):
            np.multiply(simulation.step_count, simulation.scenario.episode.period, out=self._time)
            simulation.step_count += 1
            self._load_noise("sense")
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

    def _load_noise(self, stage: str) -> None:
        if stage not in self._noisy:
            return
        for key, array in noise_arrays(self._simulation.noise_at()).items():
            self._noise[key][...] = array

    def _land(self, there: bool) -> None:
        """Bring the state to where everybody looks for it."""
        if there:
            for row, spare in self._back:
                row[...] = spare
        for above, below in self._mirror:
            above[...] = below

    def observe(self) -> np.ndarray:
        """The observation features ``(f, N)``; a new array."""
        np.multiply(self._simulation.step_count, self._simulation.scenario.episode.period, out=self._time)
        self._load_noise("observe")
        self._observe()
        return self._features.copy()


def _rows(arrays: dict[str, np.ndarray]) -> dict[Slot, np.ndarray]:
    """Every row of arrays ``(…, N)``, in C order."""
    return {
        (name, index): row
        for name, array in arrays.items()
        for index, row in enumerate(array.reshape(-1, array.shape[-1]))
    }


def _results(plan: Plan, environments: int) -> dict[str, np.ndarray]:
    """New arrays for what stages return, by name."""
    slots = [slot for stage in plan.stages.values() for slot in stage.outputs if slot[0].startswith("result.")]
    sizes = {name: 1 + max(index for other, index in slots if other == name) for name, _ in slots}
    kinds = {"result.detected": bool}
    return {name: np.empty((size, environments), kinds.get(name, float)) for name, size in sizes.items()}
