"""Where the values of a stage are kept: rows of numbers, one number per environment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from passloc_env.compiled.graph import DRAWN, Drawn, Node, TraceError, Value
from passloc_env.compiled.instructions import INSTRUCTIONS
from passloc_env.compiled.levels import Levels
from passloc_env.compiled.stage import COLUMN, FIRST, Slot, Stage

KINDS = {"double": np.dtype(float), "i64": np.dtype(np.int64), "i8": np.dtype(bool)}
"""What rows are made of, as LLVM calls it and as NumPy does."""


class Call(NamedTuple):
    """A function of NumPy on neighbouring scratch rows: so many for each operand, then as many results."""

    name: str
    first: int
    operands: int
    width: int


class Home(NamedTuple):
    """A row where a value is found."""

    row: int
    kind: str


class Table(NamedTuple):
    """A row that holds what was drawn for all steps of all environments, so many numbers for each."""

    row: int
    pitch: int


class Layout:
    """The rows of a stage: inputs, outputs, scratch, counted through.

    Args:
        stage: what to compute.
        pitches: how many numbers are drawn for each step, by owner.
        in_place: whether outputs may be written to the very rows of the inputs.
        some: whether only some environments are meant, which a row of indices names.

    Attributes:
        in_place: the argument.
        inputs, outputs: the slots of the first rows.
        kinds: what each of these is made of.
        levels: the operations.
        tables: where numbers that were drawn are looked up, by identity.
        first: where a row tells in which of a table's steps each environment's begin.
        column: where a row tells which environments are meant.
        homes: where inputs, and values of one level that others need, are found, by identity.
        stores: what each level writes where; of several rows for a value its home is first.
        calls: what NumPy does after each level.
        fixed, scratch: the numbers of rows of inputs and outputs, and of scratch rows.
    """

    def __init__(self, stage: Stage, pitches: Mapping[str, int], in_place: bool, some: bool) -> None:
        self.in_place, self.levels = in_place, Levels(stage.order, {*INSTRUCTIONS, DRAWN})
        self.inputs, self.outputs = list(stage.inputs), list(stage.outputs)
        self.kinds = [_kind(stage, slot, node) for slot, node in stage.inputs.items()]
        self.homes = {id(node): Home(row, self.kinds[row]) for row, node in enumerate(stage.inputs.values())}
        drawn = [node for node in stage.order if isinstance(node, Drawn)]
        self.tables: dict[int, Table] = {}
        for node in drawn:
            self.tables[id(node)] = Table(self._input(node.slot, "double").row, pitches[node.slot[0]])
        self.first = self._input(FIRST, "i64") if drawn else None
        self.column = self._input(COLUMN, "i64") if some else None
        self.kinds += [_kind(stage, slot, value) for slot, value in stage.outputs.items()]
        self.fixed, self.scratch = len(self.inputs) + len(self.outputs), 0
        self.stores: list[list[tuple[Home, Value]]] = [[] for _ in self.levels]
        self.calls = [
            [self._call(depth, name, nodes) for name, nodes in level.called.items()]
            for depth, level in enumerate(self.levels)
        ]
        self._schedule(stage)

    def _schedule(self, stage: Stage) -> None:
        """When outputs are written, and what must be kept from one level to another."""
        last = len(self.levels) - 1
        written: list[list[tuple[Home, Value]]] = [[] for _ in self.levels]
        for row, value in enumerate(stage.outputs.values(), len(self.inputs)):
            depth = last if self.in_place else self.levels.ready(value)
            written[depth].append((Home(row, self.kinds[row]), value))
        for depth, level in enumerate(self.levels):
            for node in level.plain:
                self._keep(depth, node.operands)
            self._keep(depth, [value for _, value in self.stores[depth] + written[depth]])
        self._keep(last, [stage.guard])
        for stores, outputs in zip(self.stores, written, strict=True):
            stores += outputs

    def _input(self, slot: Slot, kind: str) -> Home:
        self.inputs.append(slot)
        self.kinds.append(kind)
        return Home(len(self.inputs) - 1, kind)

    def _call(self, depth: int, name: str, nodes: list[Node]) -> Call:
        call = Call(name, self.scratch, len(nodes[0].operands), len(nodes))
        for operands in zip(*(node.operands for node in nodes), strict=True):
            self.stores[depth] += [(self._take("double"), operand) for operand in operands]
        self.homes |= {id(node): self._take("double") for node in nodes}
        return call

    def _keep(self, depth: int, values: Iterable[Value]) -> None:
        """Have earlier levels put away what this one needs."""
        for value in values:
            ready = self.levels.ready(value)
            if isinstance(value, Node) and id(value) not in self.homes and ready < depth:
                self.homes[id(value)] = home = self._take("i8" if value.logical else "double")
                self.stores[ready].append((home, value))

    def _take(self, kind: str) -> Home:
        self.scratch += 1
        return Home(self.fixed + self.scratch - 1, kind)


def _kind(stage: Stage, slot: Slot, value: Value) -> str:
    like = np.asarray(value.value if isinstance(value, Node) else value).dtype
    held = stage.kinds.get(slot[0], like)
    for kind, known in KINDS.items():
        if held == known:
            return kind
    raise TraceError(f"{slot[0]} holds {held}")
