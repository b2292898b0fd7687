"""A stage as machine code for this very processor, made by LLVM when it is first needed.

LLVM has the arithmetic done for several environments at once, its intermediate results in registers: that is several
times faster than NumPy, which writes every one of them to memory and reads it back. Between levels NumPy does what is
its own, see :mod:`passloc_env.compiled.levels`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from passloc_env.compiled.assembly import assembly
from passloc_env.compiled.graph import function as numpy_function
from passloc_env.compiled.layout import KINDS, Call, Layout
from passloc_env.compiled.processor import processor
from passloc_env.compiled.stage import Slot, Stage


class Machine:
    """A stage ready to run on rows.

    Args:
        stage: what to compute.
        pitches: how many numbers are drawn for each step, by owner.
        in_place: whether outputs may be written to the very rows of the inputs.
        some: whether only some environments are meant, which a row of indices names.
        lanes: how many environments at once; as many as the processor has room for by default.

    Attributes:
        scratch: how many scratch rows it needs.
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
        self.scratch = self._layout.scratch
        lanes = 1 if some else lanes or processor().lanes
        self._code = processor().compile(assembly(self._layout, stage, lanes))
        kind = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_int64)
        addresses = [self._code.get_function_address(f"level{depth}") for depth in range(len(self._layout.levels))]
        self._functions = [kind(address) for address in addresses]

    def __call__(
        self, inputs: Mapping[Slot, np.ndarray], outputs: Mapping[Slot, np.ndarray], scratch: np.ndarray
    ) -> Run:
        """What runs the stage on these very rows.

        Args:
            inputs: contiguous rows ``(N,)``; of what was drawn for every step all numbers, from the one on that is
                meant in the first step of all.
            outputs: contiguous rows ``(N,)``.
            scratch: rows ``(≥ scratch, N)`` that nobody else uses meanwhile.

        Raises:
            TypeError: rows of another kind than the stage was traced on.
        """
        layout = self._layout
        rows = [inputs[slot] for slot in layout.inputs] + [outputs[slot] for slot in layout.outputs]
        for row, kind in zip(rows, layout.kinds, strict=True):
            if row.dtype != KINDS[kind] or row.strides != (row.itemsize,):
                raise TypeError(f"a row of {row.dtype} with strides {row.strides} where {KINDS[kind]} is expected")
        return Run(self._code, self._functions, layout.calls, rows, scratch)


_Step = tuple[Callable[[int, int], bool], list[tuple[Any, list[np.ndarray], np.ndarray]]]
"""A function in machine code, and what NumPy does after it."""


class Run:
    """A stage bound to rows, which it keeps alive."""

    def __init__(
        self,
        code: Any,
        functions: Sequence[Callable[[int, int], bool]],
        calls: list[list[Call]],
        rows: list[np.ndarray],
        scratch: np.ndarray,
    ) -> None:
        starts = [row.ctypes.data for row in (*rows, *scratch)]
        self._kept = code, rows, (ctypes.c_void_p * len(starts))(*starts)
        self._table = ctypes.addressof(self._kept[-1])
        self._functions, self._calls, self._scratch = functions, calls, scratch
        self._bound: dict[int, list[_Step]] = {}
        self._environments = scratch.shape[1]

    def __call__(self, environments: int | None = None) -> bool:
        """Run for all environments, or for the first ones; tells whether the guard held everywhere."""
        environments = self._environments if environments is None else environments
        met, table = True, self._table
        for function, calls in self._bound.get(environments) or self._bind(environments):
            met &= function(table, environments)
            for called, operands, result in calls:
                called(*operands, out=result)
        return met

    def _bind(self, environments: int) -> list[_Step]:
        """What is to be done for so many; kept for the next time."""
        scratch = self._scratch[:, :environments]
        self._bound[environments] = steps = [
            (function, [_bound(call, scratch) for call in calls])
            for function, calls in zip(self._functions, self._calls, strict=True)
        ]
        return steps


def _bound(call: Call, scratch: np.ndarray) -> tuple[Any, list[np.ndarray], np.ndarray]:
    """A function of NumPy with the blocks of scratch rows that it reads, and that which it writes."""
    blocks = [
        scratch[call.first + part * call.width : call.first + (part + 1) * call.width]
        for part in range(call.operands + 1)
    ]
    blocks = [block.reshape(-1) if block.flags.c_contiguous else block for block in blocks]
    return numpy_function(call.name), blocks[:-1], blocks[-1]
