"""A stage as machine code for this very processor, made by LLVM when it is first needed.

LLVM has the arithmetic done for several environments at once, its intermediate results in registers: that is several
times faster than NumPy, which writes every one of them to memory and reads it back. Between levels NumPy does what is
its own, see :mod:`passloc_env.compiled.levels`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from passloc_env.compiled.assembly import assembly
from passloc_env.compiled.graph import function as numpy_function
from passloc_env.compiled.layout import KINDS, Call, Layout
from passloc_env.compiled.processor import processor
from passloc_env.compiled.stage import Slot, Stage

_CHUNK = 512
"""Environments that run through a stage together: their scratch rows stay in the cache."""

_LINE = 8
"""Numbers in a line of the cache. Rows an odd number of lines apart do not get into each other's way there."""


class Machine:
    """A stage ready to run on rows.

    Args:
        stage: what to compute.
        pitches: owners of inputs that are kept step by step, and the numbers of a step.
        in_place: whether outputs may be written to the very rows of the inputs.
        some: whether only some environments are meant, which a row of indices names.
        lanes: how many environments at once; as many as the processor has room for by default.
    """

    def __init__(
        self,
        stage: Stage,
        pitches: Mapping[str, int] | None = None,
        in_place: bool = False,
        some: bool = False,
        lanes: int | None = None,
    ) -> None:
        self._layout = Layout(stage, pitches or {}, in_place, some)
        lanes = 1 if some else lanes or processor().lanes
        self._code = processor().compile(assembly(self._layout, stage, lanes))
        kind = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_int64)
        addresses = [self._code.get_function_address(f"level{depth}") for depth in range(len(self._layout.levels))]
        self._functions = [kind(address) for address in addresses]

    def __call__(self, inputs: Mapping[Slot, np.ndarray], outputs: Mapping[Slot, np.ndarray]) -> Run:
        """What runs the stage on these very rows.

        Args:
            inputs: contiguous rows ``(N,)``; of what is kept step by step the whole of it, ``(N · steps · pitch,)``,
                from the number on that is meant.
            outputs: contiguous rows ``(N,)``.

        Raises:
            TypeError: rows of another kind than the stage was traced on.
        """
        layout = self._layout
        rows = [inputs[slot] for slot in layout.inputs] + [outputs[slot] for slot in layout.outputs]
        for row, kind in zip(rows, layout.kinds, strict=True):
            if row.dtype != KINDS[kind] or row.strides != (row.itemsize,):
                raise TypeError(f"a row of {row.dtype} with strides {row.strides} where {KINDS[kind]} is expected")
        whole = {home.row for home in layout.homes.values() if home.pitch}
        environments = min((row.size for at, row in enumerate(rows) if at not in whole), default=0)
        if layout.column is not None:
            whole = set(range(len(rows))) - {layout.column.row}
        return Run(self._code, self._functions, layout.calls, Rows(rows, whole, layout.scratch, environments))


class Rows:
    """Rows in memory, and scratch rows for a chunk of their environments."""

    def __init__(self, rows: list[np.ndarray], whole: set[int], scratch: int, environments: int) -> None:
        chunks = max(-(-environments // _CHUNK), 1)
        self.edges = [environments * chunk // chunks for chunk in range(chunks + 1)]
        self.scratch = np.empty((scratch, _row_length(-(-environments // chunks))))
        self._rows = rows
        self._tables = []
        for first in self.edges[:-1]:
            starts = [row.ctypes.data + (at not in whole) * first * row.itemsize for at, row in enumerate(rows)]
            starts += [row.ctypes.data for row in self.scratch]
            self._tables.append((ctypes.c_void_p * len(starts))(*starts))
        self.tables = [ctypes.addressof(table) for table in self._tables]


class Run:
    """A stage bound to rows: machine code and NumPy's functions, chunk by chunk."""

    def __init__(self, code: Any, functions: Sequence[Callable[[int, int], bool]], calls: list[list[Call]], rows: Rows):
        self._code, self._rows = code, rows
        self._functions, self._calls = functions, calls
        self._whole = [
            (table, last - first, self._bound(last - first))
            for table, (first, last) in zip(rows.tables, pairwise(rows.edges), strict=True)
        ]

    def __call__(self) -> bool:
        """Run for all environments; tells whether the guard held everywhere."""
        met = True
        for table, environments, steps in self._whole:
            met &= _run(table, environments, steps)
        return met

    def first(self, environments: int) -> bool:
        """The same for so many only."""
        met = True
        for (table, size, steps), start in zip(self._whole, self._rows.edges, strict=False):
            left = min(environments - start, size)
            if left > 0:
                met &= _run(table, left, steps if left == size else self._bound(left))
        return met

    def _bound(self, environments: int) -> list[_Step]:
        scratch = self._rows.scratch[:, :environments]
        return [
            (function, [_bound(call, scratch) for call in calls])
            for function, calls in zip(self._functions, self._calls, strict=True)
        ]


_Step = tuple[Callable[[int, int], bool], list[tuple[Any, list[np.ndarray], np.ndarray]]]
"""A function in machine code, and what NumPy does after it."""


def _run(table: int, environments: int, steps: list[_Step]) -> bool:
    met = True
    for function, calls in steps:
        met &= function(table, environments)
        for called, operands, result in calls:
            called(*operands, out=result)
    return met


def _bound(call: Call, scratch: np.ndarray) -> tuple[Any, list[np.ndarray], np.ndarray]:
    """A function of NumPy with the blocks of scratch rows that it reads, and that which it writes."""
    blocks = [
        scratch[call.first + part * call.width : call.first + (part + 1) * call.width]
        for part in range(call.operands + 1)
    ]
    blocks = [block.reshape(-1) if block.flags.c_contiguous else block for block in blocks]
    return numpy_function(call.name), blocks[:-1], blocks[-1]


def _row_length(environments: int) -> int:
    """How long to make scratch rows: few environments lie close together, many are kept out of each other's way."""
    if environments <= _CHUNK // 16:
        return environments
    lines = -(-environments // _LINE)
    return _LINE * (lines + 1 - lines % 2)
