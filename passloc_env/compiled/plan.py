"""What can be flown of a scenario as straight-line code: its stages, traced and compiled once and kept."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np

from passloc_env.compiled.graph import TraceError
from passloc_env.compiled.machine import Machine
from passloc_env.compiled.stage import STAGES, Slot, Stage, copying, is_symmetric, live_arrays, trace


class Plan:
    """The traced stages of a scenario.

    Attributes:
        stages: by name; without an opening where that is no straight-line arithmetic.
    """

    def __init__(self, simulation: Any) -> None:
        self.stages: dict[str, Stage] = {name: trace(simulation, name) for name in STAGES if name != "open"}
        with suppress(TraceError):
            self.stages["open"] = trace(simulation, "open")
        if any(self.stages[name].guard is not None for name in ("decide", "conclude", "observe")):
            raise TraceError("only an opening and a sensor step may depend on what happens")
        self._pitches = {f"step.{kind}": table.pitch for kind, table in simulation.noise.tables().items()}
        sense = self.stages["sense"].outputs
        halves = {above: below for above, below in self._mirrored(simulation).items() if below in sense}
        self.stages["mirror"] = copying(halves, sense)
        self.stages["sense"].outputs = {slot: value for slot, value in sense.items() if slot not in halves}
        back = {slot: slot for slot in self.stages["sense"].outputs if not slot[0].startswith("result.")}
        self.stages["back"] = copying(back, sense)

    def _mirrored(self, simulation: Any) -> dict[Slot, Slot]:
        """Slots of symmetric arrays above their diagonal, each with the slot that it repeats."""
        pairs: dict[Slot, Slot] = {}
        outputs = self.stages["sense"].outputs
        for name, array in live_arrays(simulation).items():
            if not is_symmetric(name):
                continue
            places = np.arange(array[..., 0].size).reshape(array.shape[:-1])
            for row in range(len(places)):
                for column in range(row):
                    below, above = places[row, column].ravel(), places[column, row].ravel()
                    pairs |= {(name, int(a)): (name, int(b)) for a, b in zip(above, below, strict=True)}
        for above, below in pairs.items():
            if outputs.get(above) is not outputs.get(below):
                raise TraceError(f"{above[0]} does not stay symmetric")
        return pairs

    @cached_property
    def machines(self) -> dict[str, Machine]:
        """Every stage as machine code; all but a sensor step may write where they read."""
        return {
            name: Machine(stage, self._pitches, in_place=name != "sense", some=name == "open")
            for name, stage in self.stages.items()
        }
