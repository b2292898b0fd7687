"""Straight-line arithmetic: what a step of one environment computes, as a graph of scalar operations.

A :class:`Graph` is filled by running the very code of the simulation on symbols
(:mod:`passloc_env.compiled.traced`), so there is no second copy of any formula. Every operation knows its value in the
example that it was traced with: where the code asks for a truth value, the answer of the example is taken and kept as
a *guard*, a condition under which the graph stands for the code. What is computed twice is computed once; operations
on constants are constants.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from passloc_env.special import FURTHER

Value = Any
"""An operation's operand: a :class:`Node`, or a Python float or bool."""

_COMMUTATIVE = {"add", "multiply"}
"""Operations whose operands may be exchanged to the last bit."""


DRAWN = "drawn"
"""Name of the operation that looks up the noise of a step."""


class TraceError(Exception):
    """The code does something that straight-line arithmetic cannot express."""


class Node:
    """One scalar operation, or (without operands) an input."""

    __slots__ = ("graph", "name", "operands", "value")

    def __init__(self, graph: Graph, name: str, operands: tuple[Value, ...], value: float | bool) -> None:
        self.graph, self.name, self.operands, self.value = graph, name, operands, value

    @property
    def logical(self) -> bool:
        """Whether it is a truth value."""
        return isinstance(self.value, bool)

    @property
    def counts(self) -> bool:
        """Whether it is a whole number: rows hold it as a float until it is put away."""
        return isinstance(self.value, int) and not self.logical

    def __bool__(self) -> bool:
        self.graph.guards.append(Guard(self, bool(self.value)))
        return bool(self.value)

    def __float__(self) -> float:
        raise TraceError("a number is asked for where only a symbol exists")


class Drawn(Node):
    """A number that was drawn for a step of an episode; its operand is the step.

    Attributes:
        slot: which of the numbers that were drawn for each step.
    """

    __slots__ = ("slot",)

    def __init__(self, graph: Graph, slot: tuple[str, int], step: Value, value: float) -> None:
        super().__init__(graph, DRAWN, (step,), value)
        self.slot = slot


class Guard(NamedTuple):
    """A condition under which the graph stands for the code."""

    node: Node
    expected: bool


class Graph:
    """Operations in the order in which they can be done.

    Attributes:
        guards: conditions that must come out as in the example.
    """

    def __init__(self) -> None:
        self.guards: list[Guard] = []
        self._known: dict[tuple[str, ...], Node] = {}

    def input(self, value: float | bool) -> Node:
        """A new input with its value in the example."""
        return Node(self, "input", (), value)

    def apply(self, name: str, operands: tuple[Value, ...]) -> Value:
        """The result of one of NumPy's functions, the known one where it has been asked for before."""
        simple = _simplified(name, operands)
        if simple is not None:
            return simple
        parts = [f"{id(o)}" if isinstance(o, Node) else repr(o) for o in operands]
        key = (name, *(sorted(parts) if name in _COMMUTATIVE else parts))
        node = self._known.get(key)
        if node is None:
            values = [o.value if isinstance(o, Node) else o for o in operands]
            self._known[key] = node = Node(self, name, operands, evaluate(name, values))
        return node

    def order(self, results: list[Value]) -> list[Node]:
        """Every operation that the results need, each after its operands; inputs are left out."""
        done: set[int] = set()
        ordered: list[Node] = []
        stack: list[tuple[Value, bool]] = [(result, False) for result in reversed(results)]
        while stack:
            node, ready = stack.pop()
            if not isinstance(node, Node) or id(node) in done or node.name == "input":
                continue
            if ready:
                done.add(id(node))
                ordered.append(node)
            else:
                stack.append((node, True))
                stack.extend((operand, False) for operand in reversed(node.operands))
        return ordered


def function(name: str) -> Any:
    """The function of an operation: NumPy's, or one that NumPy lacks."""
    return FURTHER.get(name) or getattr(np, name)


def evaluate(name: str, values: list[Any]) -> float | bool:
    """One operation on numbers, by NumPy."""
    with np.errstate(all="ignore"):
        result = function(name)(*values)
    value: float | bool = np.asarray(result).item()
    return value


def _simplified(name: str, operands: tuple[Value, ...]) -> Value | None:
    """The result where it is a constant or one of the operands; the signs of zeros are not kept."""
    constants = [not isinstance(operand, Node) for operand in operands]
    if all(constants):
        return evaluate(name, list(operands))
    if name == "where" and constants[0]:
        return operands[1] if operands[0] else operands[2]
    if len(operands) == 2 and any(constants):
        left, right = operands
        if name == "multiply":
            if left == 1.0 and constants[0]:
                return right
            if right == 1.0 and constants[1]:
                return left
            if (constants[0] and left == 0.0) or (constants[1] and right == 0.0):
                return 0.0
        elif name == "add":
            if constants[0] and left == 0.0:
                return right
            if constants[1] and right == 0.0:
                return left
        elif name == "subtract" and constants[1] and right == 0.0:
            return left
        elif name == "divide":
            if constants[1] and right == 1.0:
                return left
            if constants[0] and left == 0.0:
                return 0.0
    return None
