"""A section of a flight: neighbouring environments whose rows fit into the cache together.

A sensor step reads the state from one set of rows and writes it to another, and the sets change places. So nothing is
lost where a guard does not hold: the step is done again by the simulation's own methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from passloc_env.arrays import lasting
from passloc_env.compiled.plan import Plan
from passloc_env.compiled.stage import Slot, live_arrays


class Workspace:
    """What a section needs while it flies, and the next one after it: it stays in the cache.

    Args:
        plan: what is flown.
        environments: of the largest section.
        kinds: the rows that a sensor step writes, and what they are made of.
    """

    def __init__(self, plan: Plan, environments: int, kinds: Mapping[Slot, np.dtype[Any]]) -> None:
        self._scratch = lasting((max(machine.scratch for machine in plan.machines.values()), environments))
        self._spare, self._kinds = lasting((len(kinds), environments)), kinds

    def scratch(self, environments: int) -> np.ndarray:
        """Scratch rows ``(k, N)``."""
        return self._scratch[:, :environments]

    def spare(self, environments: int) -> dict[Slot, np.ndarray]:
        """The other set of rows ``(N,)``."""
        pairs = zip(self._kinds.items(), self._spare, strict=True)
        return {slot: row.view(kind)[:environments] for (slot, kind), row in pairs}


class Section:
    """Environments ``part`` of a simulation.

    Args:
        plan: what is flown.
        simulation: the whole.
        part: which of its environments.
        rows: the section's rows by slot.
        workspace: shared with other sections, of which one flies at a time.

    Attributes:
        decide, conclude, observe: run the stages of these names.
        detected: which scalars ``(m, N)`` the simulation's own methods measured in the last sensor step, where they
            made it and not all were.
    """

    def __init__(
        self, plan: Plan, simulation: Any, part: slice, rows: Mapping[Slot, np.ndarray], workspace: Workspace
    ) -> None:
        size = part.stop - part.start
        self._simulation, self.part = simulation, part
        self.detected: np.ndarray | None = None
        self._by_methods: Any = None
        scratch = workspace.scratch(size)
        here, there = rows, {**rows, **workspace.spare(size)}
        machines = plan.machines
        self._sense = machines["sense"](here, there, scratch), machines["sense"](there, here, scratch)
        self._back = machines["back"](there, here, scratch)
        self.decide, self._mirror, self.conclude, self.observe = (
            machines[name](here, here, scratch) for name in ("decide", "mirror", "conclude", "observe")
        )
        self._there = False

    def sense(self) -> bool:
        """One sensor step; false where it had to be done by the simulation's own methods."""
        done = self._sense[self._there]()
        if done:
            self._there, self.detected = not self._there, None
        else:
            self.land()
            self._repeat()
        return done

    def land(self) -> None:
        """Bring the state to where everybody looks for it."""
        if self._there:
            self._back()
            self._there = False
        self._mirror()

    def _repeat(self) -> None:
        """Let a simulation of these environments alone make the step by its methods."""
        whole = self._simulation
        if self._by_methods is None:
            self._by_methods = type(whole)(whole.scenario, self.part.stop - self.part.start, straight=False)
        alone = self._by_methods
        alone.restore({name: array[..., self.part] for name, array in whole.state_arrays().items()})
        alone.advance()
        theirs = live_arrays(alone)
        for name, array in live_arrays(whole).items():
            array[..., self.part] = theirs[name]
        self.detected = alone.detected
