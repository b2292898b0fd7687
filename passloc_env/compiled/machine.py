"""A stage as machine code for this very processor, made by LLVM when it is first needed.

LLVM has the arithmetic done for several environments at once, its intermediate results in registers: that is several
times faster than NumPy, which writes every one of them to memory and reads it back. Between levels NumPy does what is
its own, see :mod:`passloc_env.compiled.levels`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from passloc_env.compiled.assembly import assembly
from passloc_env.compiled.graph import function
from passloc_env.compiled.layout import KINDS, Call, Layout
from passloc_env.compiled.processor import processor
from passloc_env.compiled.stage import Slot, Stage

_CHUNK = 1024
"""Environments that run through a stage together: their scratch rows stay in the cache."""

_LINE = 8
"""Numbers in a line of the cache. Rows an odd number of lines apart do not get into each other's way there."""


class Machine:
    """A stage ready to run on rows.

    Args:
        stage: what to compute.
        pitches: owners of inputs that are kept step by step, and the numbers of a step.
        in_place: whether outputs may be written to the very rows of the inputs.
        lanes: how many environments at once; as many as the processor has room for by default.
    """

    def __init__(
        self, stage: Stage, pitches: Mapping[str, int] | None = None, in_place: bool = False, lanes: int | None = None
    ) -> None:
        self._layout = Layout(stage, pitches or {}, in_place)
        self._code = processor().compile(assembly(self._layout, stage, lanes or processor().lanes))
        kind = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_int64)
        addresses = [self._code.get_function_address(f"level{depth}") for depth in range(len(self._layout.levels))]
        self._functions = [kind(address) for address in addresses]

    def __call__(self, inputs: Mapping[Slot, np.ndarray], outputs: Mapping[Slot, np.ndarray]) -> Callable[[], bool]:
        """What runs the stage on these very rows, and tells whether the guard held everywhere.

        Args:
            inputs: contiguous rows ``(N,)``; of what is kept step by step the whole of it, ``(N · steps · pitch,)``,
                from the number on that is meant.
            outputs: contiguous rows ``(N,)``.
        """
        layout = self._layout
        rows = [inputs[slot] for slot in layout.inputs] + [outputs[slot] for slot in layout.outputs]
        for row, kind in zip(rows, layout.kinds, strict=True):
            if row.dtype != KINDS[kind] or row.strides != (row.itemsize,):
                raise TypeError(f"a row of {row.dtype} with strides {row.strides} where {KINDS[kind]} is expected")
        stepwise = {home.row for home in layout.homes.values() if home.pitch}
        environments = min((row.size for at, row in enumerate(rows) if at not in stepwise), default=0)
        chunks = -(-environments // _CHUNK)
        edges = [environments * chunk // chunks for chunk in range(chunks + 1)] if chunks else [0]
        scratch = np.empty((layout.scratch, _row_length(-(-environments // max(chunks, 1)))))
        runs: list[tuple[Callable[[int, int], bool], int, int, list[Any]]] = []
        tables = []
        for first, last in pairwise(edges):
            starts = [row.ctypes.data + (at not in stepwise) * first * row.itemsize for at, row in enumerate(rows)]
            starts += [row.ctypes.data for row in scratch]
            tables.append((ctypes.c_void_p * len(starts))(*starts))
            for run, calls in zip(self._functions, layout.calls, strict=True):
                bound = [_bound(call, scratch[:, : last - first]) for call in calls]
                runs.append((run, ctypes.addressof(tables[-1]), last - first, bound))
        return _Run(runs, (self._code, rows, tables, scratch))


class _Run:
    """Machine code bound to rows, which it keeps alive."""

    def __init__(self, runs: list[tuple[Callable[[int, int], bool], int, int, list[Any]]], kept: Any) -> None:
        self._runs, self._kept = runs, kept

    def __call__(self) -> bool:
        met = True
        for run, table, environments, calls in self._runs:
            met &= run(table, environments)
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
    return function(call.name), blocks[:-1], blocks[-1]


def _row_length(environments: int) -> int:
    """How long to make scratch rows: few environments lie close together, many are kept out of each other's way."""
    if environments <= _CHUNK // 16:
        return environments
    lines = -(-environments // _LINE)
    return _LINE * (lines + 1 - lines % 2)
