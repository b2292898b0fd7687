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
        names: dict[int, str] = {}
        lines: list[str] = []
        for index, (slot, node) in enumerate(stage.inputs.items()):
            names[id(node)] = f"i{index}"
            lines.append(f"i{index} = values[{places[slot]}]")

        def name(value: Value) -> str:
            return names[id(value)] if isinstance(value, Node) else f"({value!r})"

        foreign = set()
        for index, node in enumerate(stage.order):
            operands = [name(operand) for operand in node.operands]
            if node.name in _EXPRESSIONS:
                expression = _EXPRESSIONS[node.name].format(*operands)
            else:
                foreign.add(node.name)
                expression = f"{node.name}({', '.join(operands)}).item()"
            names[id(node)] = f"t{index}"
            lines.append(f"t{index} = {expression}")
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
        scope |= {"inf": np.inf, "nan": np.nan} | {used: function(used) for used in foreign}
        exec(compile(source, f"<{len(stage.order)} operations on floats>", "exec"), scope)
        self.run: Callable[[list[Any]], bool] = scope["run"]
