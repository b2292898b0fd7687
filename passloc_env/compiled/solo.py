"""Flying one environment by its plan, on Python floats: NumPy's calls would cost more than their work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from passloc_env.compiled.plan import Plan
from passloc_env.compiled.stage import Slot, live_arrays, noise_arrays

_UNDEFINED = (ZeroDivisionError, ValueError, OverflowError)
"""What Python raises where NumPy says NaN or infinity."""


class SoloFlight:
    """One environment flown on floats; :attr:`repeated` counts the sensor steps done again."""

    def __init__(self, plan: Plan, simulation: Any) -> None:
        self._simulation, self.repeated = simulation, 0
        self._values: list[Any] = []
        self._places: dict[Slot, int] = {}
        written = {name for stage in plan.stages.values() for name, _ in stage.outputs}
        live = live_arrays(simulation)
        parts = {name: (array.reshape(-1), self._add(name, array)) for name, array in live.items()}
        self._loads = [part for part in parts.values() if part[0].size]
        self._stores = [parts[name] for name in live if name in written]
        first = len(self._values)
        for name, array in noise_arrays(simulation.noise_at()).items():
            self._add(name, array)
        self._noise = slice(first, len(self._values))
        self._action = self._add("argument.action", simulation.action)
        self._time = self._add("argument.time", simulation.time).start
        for stage in plan.stages.values():
            for slot in stage.outputs:
                if slot not in self._places:
                    self._places[slot] = len(self._values)
                    self._values.append(0.0)
        self._results = {
            name: [place for (owner, _), place in self._places.items() if owner == name]
            for name in ("result.observation", "result.detected")
        }
        self._clock = self._places["simulation.step_count", 0]
        run = {name: code.run for name, code in plan.scalars(self._places).items()}
        self._decide, self._sense, self._conclude, self._observe = (
            run[name] for name in ("decide", "sense", "conclude", "observe")
        )

    def _add(self, name: str, array: np.ndarray) -> slice:
        first = len(self._values)
        self._values += array.reshape(-1).tolist()
        self._places |= {(name, index): first + index for index in range(array.size)}
        return slice(first, len(self._values))

    def step(self, action: np.ndarray) -> None:
        """One decision."""
        simulation, values = self._simulation, self._values
        episode = simulation.scenario.episode
        self._load()
        values[self._action] = action[:, 0].tolist()
        count = values[self._clock]
        values[self._noise] = simulation.noise.alone(min(count, episode.steps))
        if not self._done(self._decide):
            simulation.decide(action, simulation.noise_at())
            self._load()
        for _ in range(episode.decision_every):
            values[self._time] = count * episode.period
            count += 1
            values[self._clock] = count
            values[self._noise] = simulation.noise.alone(min(count, episode.steps))
            done = self._done(self._sense)
            if not done or simulation.watchers:
                self._store()
                self._show()
                if not done:
                    self.repeated += 1
                    simulation.sense(np.array([values[self._time]]), simulation.noise_at())
                simulation.tell()
                self._load()
        concluded = self._done(self._conclude)
        self._store()
        if done:
            self._show()
        if not concluded:
            simulation.conclude()

    def observe(self) -> np.ndarray:
        """The observation features ``(f, 1)``; a new array."""
        values, episode = self._values, self._simulation.scenario.episode
        self._load()
        count = values[self._clock]
        values[self._time] = count * episode.period
        values[self._noise] = self._simulation.noise.alone(min(count, episode.steps))
        if not self._done(self._observe):
            belief = self._simulation.belief
            features: np.ndarray = self._simulation.realised.observation.observe(belief)
            return features
        return np.array([values[place] for place in self._results["result.observation"]])[:, None]

    def _done(self, run: Callable[[list[Any]], bool]) -> bool:
        """Whether a stage could be run; nothing has changed where it could not."""
        try:
            return run(self._values)
        except _UNDEFINED:
            return False

    def _show(self) -> None:
        """Let the simulation tell what the last sensor step came to."""
        detected = [self._values[place] for place in self._results["result.detected"]]
        self._simulation.detected = np.array(detected)[:, None] if detected else None
        self._simulation.outcome = None

    def _load(self) -> None:
        for flat, place in self._loads:
            self._values[place] = flat.tolist()

    def _store(self) -> None:
        for flat, place in self._stores:
            flat[:] = self._values[place]
        self._simulation.step_count[0] = self._values[self._clock]
