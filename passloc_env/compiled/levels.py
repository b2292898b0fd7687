"""The operations of a stage cut into levels: arithmetic that machine code does, then functions that NumPy does.

Sums, products, quotients and roots are the same to the last bit wherever they are done. Sines and logarithms are not:
they go through NumPy, all like ones of a level in one call.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field

from passloc_env.compiled.graph import Node, Value


@dataclass
class Level:
    """Arithmetic, in an order in which it can be done, and then the functions of NumPy that it feeds, by name."""

    plain: list[Node] = field(default_factory=list)
    called: dict[str, list[Node]] = field(default_factory=dict)


class Levels(list[Level]):
    """A stage's operations by how many of NumPy's functions stand, one after the other, between the inputs and them.

    Args:
        order: the operations, each after its operands.
        plain: names of those that machine code does.
    """

    def __init__(self, order: list[Node], plain: Container[str]) -> None:
        super().__init__()
        self._plain = plain
        self._depth: dict[int, int] = {}
        for node in order:
            self._depth[id(node)] = max((self.ready(operand) for operand in node.operands), default=0)
        self._defer(order)
        self += [Level() for _ in range(1 + max((self.ready(node) for node in order), default=0))]
        for node in order:
            level = self[self._depth[id(node)]]
            if node.name in plain:
                level.plain.append(node)
            else:
                level.called.setdefault(node.name, []).append(node)

    def ready(self, value: Value) -> int:
        """The first level whose arithmetic may use a value."""
        depth = self._depth.get(id(value)) if isinstance(value, Node) else None
        return 0 if depth is None else depth + (value.name not in self._plain)

    def _defer(self, order: list[Node]) -> None:
        """Let what needs inputs alone wait until somebody needs it: inputs are at hand in every level.

        A value that waits need not be put away and fetched again in between.
        """
        needed: dict[int, int] = {}
        for node in reversed(order):
            depth = self._depth[id(node)]
            if depth == 0 and node.name in self._plain:
                self._depth[id(node)] = depth = needed.get(id(node), 0)
            for operand in node.operands:
                needed[id(operand)] = min(depth, needed.get(id(operand), depth))
