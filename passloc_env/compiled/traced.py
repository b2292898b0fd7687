"""Arrays of symbols that go through NumPy code as if they were numbers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from passloc_env.compiled.graph import Graph, Node, TraceError, Value, evaluate


class Traced(np.ndarray):
    """An object array of nodes and constants; its batch axis has length one.

    Slicing, views and broadcasting are NumPy's own. Functions of numbers put operations into the graph.
    """

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        """Put the operation of a ufunc into the graph, element by element."""
        axis = options.pop("axis", 0)
        options = {name: value for name, value in options.items() if value not in _HARMLESS}
        if method == "reduce":
            result = _reduced(ufunc, inputs[0], axis)
        elif method == "__call__":
            # NumPy's name for functions made from Python's.
            name = ufunc.__name__.removesuffix(" (vectorized)")
            result = _elementwise(name, ufunc.nin)(*map(_plain, inputs))
        else:
            raise TraceError(f"numpy.{ufunc.__name__}.{method}")
        if options:
            raise TraceError(f"numpy.{ufunc.__name__} with {', '.join(options)}")
        if out is None:
            return _traced(result)
        if not isinstance(out[0], Traced):
            raise TraceError(f"numpy.{ufunc.__name__} writes symbols into an array of numbers")
        out[0][...] = result
        return out[0]

    def __array_function__(self, func: Callable[..., Any], types: Any, args: Any, kwargs: Any) -> Any:
        """NumPy's functions that move elements work as they are; ``where`` is an operation."""
        if func is np.where and len(args) == 3:
            return _traced(_elementwise("where", 3)(*map(_plain, args)))
        if func in _FILLED:
            return np.full(kwargs.get("shape", args[0].shape), _FILLED[func], dtype=object).view(Traced)
        if func not in _MOVING:
            raise TraceError(f"numpy.{func.__name__}")
        return _traced(func(*_deep_plain(args), **{key: _deep_plain(value) for key, value in kwargs.items()}))


_HARMLESS = (None, False, bool, "C", "K")
"""Values of a ufunc's options that change no result."""

_FILLED: dict[Callable[..., Any], float | bool] = {np.empty_like: 0.0, np.zeros_like: 0.0, np.ones_like: True}
"""New arrays, and what stands in them; ones are made for masks only."""

_MOVING = {
    np.concatenate,
    np.stack,
    np.broadcast_to,
    np.moveaxis,
    np.reshape,
    np.copyto,
    np.einsum,
    np.diagonal,
    np.shape,
    np.atleast_1d,
    np.ascontiguousarray,
    np.size,
}


def symbols(graph: Graph, example: np.ndarray) -> Traced:
    """New inputs in the shape of an example without its batch axis ``(…)``, as an array ``(…, 1)``."""
    nodes = np.empty(example.shape, dtype=object)
    for index, value in np.ndenumerate(example):
        nodes[index] = graph.input(value.item())
    return nodes[..., None].view(Traced)


def _traced(result: Any) -> Any:
    return result.view(Traced) if isinstance(result, np.ndarray) else result


def _plain(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, Traced) else value


def _deep_plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return type(value)(_deep_plain(item) for item in value)
    return _plain(value)


@cache
def _elementwise(name: str, operands: int) -> Any:
    def apply(*values: Value) -> Value:
        values = tuple(v.item() if isinstance(v, (np.generic, np.ndarray)) else v for v in values)
        for value in values:
            if isinstance(value, Node):
                return value.graph.apply(name, values)
        return evaluate(name, list(values))

    return np.frompyfunc(apply, operands, 1)


def _reduced(ufunc: Any, array: Any, axis: int | tuple[int, ...] | None) -> Any:
    """Fold one axis, some, or all of them, from the first element to the last."""
    plain = _plain(array)
    if axis is None:
        plain, axis = plain.reshape(-1), 0
    if isinstance(axis, tuple):
        plain = np.moveaxis(plain, axis, range(len(axis)))
        plain, axis = plain.reshape(-1, *plain.shape[len(axis) :]), 0
    terms = np.moveaxis(plain, axis, 0)
    total = terms[0]
    for term in terms[1:]:
        total = _elementwise(ufunc.__name__, 2)(total, term)
    return total
