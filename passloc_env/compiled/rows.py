"""A stage as NumPy code for many environments: one call per operation, on rows ``(N,)`` that stay in the cache."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from passloc_env.compiled.graph import Node, Value, function
from passloc_env.compiled.stage import Slot, Stage

_KEYWORD_OUT = {"maximum", "minimum"}
"""Functions that want their output by keyword."""


class Rows:
    """A stage ready to run on rows.

    Args:
        stage: what to compute.
        skipped: outputs that nobody reads.
    """

    def __init__(self, stage: Stage, skipped: frozenset[Slot] = frozenset()) -> None:
        self.inputs = list(stage.inputs)
        self.outputs = [slot for slot in stage.outputs if slot not in skipped]
        writer = _Writer(stage, self.outputs)
        self._scratch_sizes = len(writer.pool[False].rows), len(writer.pool[True].rows)
        self._constants = tuple(np.asarray(value) for value in writer.constants)
        functions = {node.name: function(node.name) for node in stage.order if node.name != "where"}
        names: dict[str, Any] = {**functions, "copyto": np.copyto}
        exec(compile(writer.source(), f"<{len(stage.order)} operations on rows>", "exec"), names)
        self._run: Callable[..., np.ndarray | None] = names["run"]

    def scratch(self, environments: int) -> tuple[np.ndarray, ...]:
        """Rows that :meth:`__call__` needs, to be used again and again."""
        numbers, flags = self._scratch_sizes
        return (*np.empty((numbers, environments)), *np.empty((flags, environments), bool))

    def __call__(
        self, inputs: Mapping[Slot, np.ndarray], outputs: Mapping[Slot, np.ndarray], scratch: tuple[np.ndarray, ...]
    ) -> Callable[[], bool]:
        """What runs the stage on these very rows, and tells whether the guard held everywhere."""
        arguments = (
            tuple(inputs[slot] for slot in self.inputs),
            tuple(outputs[slot] for slot in self.outputs),
            scratch,
            self._constants,
        )
        run = self._run

        def bound() -> bool:
            guard = run(*arguments)
            return guard is None or bool(np.logical_and.reduce(guard))

        return bound


class _Pool:
    """Scratch rows of one kind; a row given back is the next one handed out, while it is still in the cache."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.rows: list[str] = []
        self.free: list[str] = []

    def take(self) -> str:
        if not self.free:
            self.rows.append(f"{self.prefix}{len(self.rows)}")
            return self.rows[-1]
        return self.free.pop()


class _Writer:
    """Lines of code, in which every operation writes to an output row or to a scratch row that is free by then."""

    def __init__(self, stage: Stage, outputs: list[Slot]) -> None:
        self.pool = {False: _Pool("t"), True: _Pool("b")}
        self.constants: list[float | bool] = []
        self._inputs, self._count_outputs = list(stage.inputs), len(outputs)
        self._names: dict[int, str] = {id(node): f"i{index}" for index, node in enumerate(stage.inputs.values())}
        self._constant_names: dict[str, str] = {}
        self._lines: list[str] = []
        self._last: dict[int, int] = {}
        for position, node in enumerate(stage.order):
            for operand in node.operands:
                self._last[id(operand)] = position
        self._write(stage, outputs)

    def _write(self, stage: Stage, outputs: list[Slot]) -> None:
        rows: dict[int, str] = {}
        for index, slot in enumerate(outputs):
            value = stage.outputs[slot]
            if isinstance(value, Node) and not value.counts:
                rows.setdefault(id(value), f"o{index}")
        held = {id(stage.outputs[slot]) for slot in outputs} | {id(stage.guard)}
        for position, node in enumerate(stage.order):
            operands = [self._name(operand) for operand in node.operands]
            ending = {id(o): o for o in node.operands if isinstance(o, Node) and o.name != "input"}
            free = [o for key, o in ending.items() if self._last[key] == position and key not in held]
            late = node.name == "where"
            if not late:
                self._release(free)
            target = rows.get(id(node)) or self.pool[node.logical].take()
            self._names[id(node)] = target
            self._lines.append(_call(node.name, operands, target))
            if late:
                self._release(free)
        for index, slot in enumerate(outputs):
            name = self._name(stage.outputs[slot])
            if name != f"o{index}":
                self._lines.append(f"copyto(o{index}, {name}, casting='unsafe')")
        self._guard = None if stage.guard is None else self._name(stage.guard)

    def _release(self, nodes: list[Node]) -> None:
        for node in nodes:
            self.pool[node.logical].free.append(self._names[id(node)])

    def _name(self, value: Value) -> str:
        if isinstance(value, Node):
            return self._names[id(value)]
        key = repr(value)
        if key not in self._constant_names:
            self._constant_names[key] = f"c{len(self.constants)}"
            self.constants.append(value)
        return self._constant_names[key]

    def source(self) -> str:
        """A function ``run(inputs, outputs, scratch, constants)`` that returns the guard's row."""
        unpacked = [
            _unpacked([f"i{index}" for index in range(len(self._inputs))], "inputs"),
            _unpacked([f"o{index}" for index in range(self._count_outputs)], "outputs"),
            _unpacked(self.pool[False].rows + self.pool[True].rows, "scratch"),
            _unpacked(list(self._constant_names.values()), "constants"),
        ]
        body = [*filter(None, unpacked), *self._lines, f"return {self._guard}"]
        return "def run(inputs, outputs, scratch, constants):\n" + "".join(f"    {line}\n" for line in body)


def _unpacked(names: list[str], source: str) -> str:
    return f"{', '.join(names)}, = {source}" if names else ""


def _call(name: str, operands: list[str], target: str) -> str:
    if name == "where":
        condition, true, false = operands
        return f"copyto({target}, {false}); copyto({target}, {true}, where={condition})"
    out = f"out={target}" if name in _KEYWORD_OUT else target
    return f"{name}({', '.join(operands)}, {out})"
