"""The batched world: act → move → measure → track → score.

One :class:`Simulation` runs any number of environments of one scenario in lockstep, each with an episode clock of its
own. It knows no Gymnasium; :mod:`passloc_env.vector_env` and :mod:`passloc_env.env` are its faces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from passloc_env.arrays import Array, IntArray
from passloc_env.compiled.flight import Flight
from passloc_env.compiled.prepare import plan_of
from passloc_env.scenario import Scenario
from passloc_env.world import World


class Simulation(World):
    """A batch of worlds with their episodes; updated in place.

    Attributes:
        watchers: called with the simulation after every sensor step.
        straight: whether the methods that make up a step may be compiled, with the same results; False for those who
            replace some of them.
    """

    def __init__(self, scenario: Scenario, environments: int, straight: bool = True) -> None:
        super().__init__(scenario, environments)
        self.straight = straight
        self.flight: Flight | None = None
        self.watchers: list[Callable[[Simulation], None]] = []

    def step(self, action: Array) -> None:
        """Fly one decision, ``action (a, N)`` finite; clipped to [-1, 1]."""
        flight = self._prepared_flight()
        with np.errstate(all="ignore"):
            if flight is not None:
                flight.step(action)
                return
            self.decide(action, self.noise_at())
            for _ in range(self.scenario.episode.decision_every):
                self.advance()
                self.tell()
            self.conclude()

    def _prepared_flight(self) -> Flight | None:
        """What flies in place of the world's methods; None where nothing else can."""
        if self.straight and self.flight is None:
            plan = plan_of(self.scenario, Simulation)
            self.straight = plan is not None
            if plan is not None:
                self.flight = Flight(plan, self)
        return self.flight if self.straight else None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the flight: it is bound to these very arrays, and made anew where it is needed."""
        return {**self.__dict__, "flight": None}

    def tell(self) -> None:
        """Call whoever watches."""
        for watch in self.watchers:
            watch(self)

    def observe(self) -> Array:
        """The observation features ``(f, N)``; a new array."""
        with np.errstate(all="ignore"):
            if self.straight and self.flight is not None:
                return self.flight.observe()
            return self.realised.observation.observe(self.belief)

    def reset(self, columns: IntArray, generators: Sequence[np.random.Generator]) -> None:
        """Begin new episodes in the given environments, one generator each, in the order of ``columns``."""
        if len(columns):
            # Environments that have never been reset hold no geometry yet, and nobody looks at them.
            with np.errstate(all="ignore"):
                self._reset(columns, generators)

    def _reset(self, columns: IntArray, generators: Sequence[np.random.Generator]) -> None:
        for column, generator in zip(columns, generators, strict=True):
            self.noise.draw(int(column), generator)
        flight = self._prepared_flight()
        if flight is None or not flight.open(columns):
            self.open(columns, self.noise.opening(self._evaluated(columns)))
        self.rebuild_models()
        self.outcome = None
