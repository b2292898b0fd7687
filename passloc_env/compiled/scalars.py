"""A stage as Python code for one environment: plain floats, in the same order of the same operations.

Sums, products, quotients and roots of floats are the same to the last bit wherever they are done. Other functions go
through NumPy, whose last bits differ from those of :mod:`math`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from passloc_env.compiled.graph import Node, Value, function
from passloc_env.compiled.stage import Slot, Stage

_EXPRESSIONS = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "divide": "{} / {}",
    "negative": "-{}",
    "square": "{0} * {0}",
    "absolute": "abs({})",
    "sqrt": "sqrt({})",
    "maximum": "{0} if {0} >= {1} or {0} != {0} else {1}",
    "minimum": "{0} if {0} <= {1} or {0} != {0} else {1}",
    "fmod": "fmod({}, {})",
    "rint": "copysign(round({0}), {0})",
    "less": "{} < {}",
    "less_equal": "{} <= {}",
    "greater": "{} > {}",
    "greater_equal": "{} >= {}",
    "equal": "{} == {}",
    "not_equal": "{} != {}",
    "logical_and": "{} and {}",
    "bitwise_and": "{} and {}",
    "logical_or": "{} or {}",
    "bitwise_or": "{} or {}",
    "logical_not": "not {}",
    "invert": "not {}",
    "isfinite": "isfinite({})",
    "isnan": "{0} != {0}",
    "where": "{1} if {0} else {2}",
}
"""What Python floats do exactly as NumPy does."""


class Scalars:
    """A stage ready to run on a list of numbers, in place.

    Args:
        stage: what to compute.
        places: where each slot is in the list.
    """

    def __init__(self, stage: Stage, places: dict[Slot, int]) -> None:
        names = {id(node): f"i{index}" for index, node in enumerate(stage.inputs.values())}
        names |= {id(node): f"t{index}" for index, node in enumerate(stage.order)}

        def name(value: Value) -> str:
            return names[id(value)] if isinstance(value, Node) else f"({value!r})"

        lines = [f"{name(node)} = values[{places[slot]}]" for slot, node in stage.inputs.items()]
        for group in _groups(stage.order):
            operands = [[name(operand) for operand in node.operands] for node in group]
            first = group[0]
            if first.name in _EXPRESSIONS:
                lines.append(f"{name(first)} = {_EXPRESSIONS[first.name].format(*operands[0])}")
            elif len(group) == 1:
                lines.append(f"{name(first)} = {first.name}({', '.join(operands[0])}).item()")
            else:
                columns = ", ".join(f"({', '.join(column)})" for column in zip(*operands, strict=True))
                lines.append(f"{', '.join(map(name, group))} = {first.name}({columns}).tolist()")
        if stage.guard is not None:
            lines.append(f"if not {name(stage.guard)}: return False")
        lines += [f"values[{places[slot]}] = {name(value)}" for slot, value in stage.outputs.items()]
        lines.append("return True")
        source = "def run(values):\n" + "".join(f"    {line}\n" for line in lines)
        scope: dict[str, Any] = {
            "sqrt": math.sqrt,
            "isfinite": math.isfinite,
            "copysign": math.copysign,
            "fmod": math.fmod,
        }
        scope |= {"inf": np.inf, "nan": np.nan}
        scope |= {node.name: function(node.name) for node in stage.order if node.name not in _EXPRESSIONS}
        exec(compile(source, f"<{len(stage.order)} operations on floats>", "exec"), scope)
        self.run: Callable[[list[Any]], bool] = scope["run"]


def _groups(order: list[Node]) -> list[list[Node]]:
    """The operations in an order in which they can be done, the like ones among NumPy's together: one call does them.

    An operation's level tells how many of NumPy's functions stand, one after the other, between the inputs and it.
    """
    levels: dict[int, int] = {}
    plain: list[list[list[Node]]] = []
    called: list[dict[str, list[Node]]] = []
    for node in order:
        own = [operand for operand in node.operands if isinstance(operand, Node) and id(operand) in levels]
        level = max((levels[id(operand)] + (operand.name not in _EXPRESSIONS) for operand in own), default=0)
        levels[id(node)] = level
        while len(plain) <= level:
            plain.append([])
            called.append({})
        if node.name in _EXPRESSIONS:
            plain[level].append([node])
        else:
            called[level].setdefault(node.name, []).append(node)
    return [group for level, groups in enumerate(plain) for group in (*groups, *called[level].values())]
