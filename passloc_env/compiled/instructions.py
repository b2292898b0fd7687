"""Operations on numbers in LLVM's assembly, for one environment or for several at once.

No instruction may be fused with another or put in another order: LLVM does neither unless it is told to. So every
number is the one that NumPy computes.
"""

from __future__ import annotations

INSTRUCTIONS: dict[str, tuple[str, ...]] = {
    "add": ("fadd {V} {0}, {1}",),
    "subtract": ("fsub {V} {0}, {1}",),
    "multiply": ("fmul {V} {0}, {1}",),
    "divide": ("fdiv {V} {0}, {1}",),
    "negative": ("fneg {V} {0}",),
    "square": ("fmul {V} {0}, {0}",),
    "absolute": ("call {V} @llvm.fabs.{S}({V} {0})",),
    "sqrt": ("call {V} @llvm.sqrt.{S}({V} {0})",),
    "floor": ("call {V} @llvm.floor.{S}({V} {0})",),
    "rint": ("call {V} @llvm.rint.{S}({V} {0})",),
    "maximum": (
        "fcmp oge {V} {0}, {1}",
        "fcmp uno {V} {0}, {0}",
        "or {B} {a}, {b}",
        "select {B} {c}, {V} {0}, {V} {1}",
    ),
    "minimum": (
        "fcmp ole {V} {0}, {1}",
        "fcmp uno {V} {0}, {0}",
        "or {B} {a}, {b}",
        "select {B} {c}, {V} {0}, {V} {1}",
    ),
    "less": ("fcmp olt {V} {0}, {1}",),
    "less_equal": ("fcmp ole {V} {0}, {1}",),
    "greater": ("fcmp ogt {V} {0}, {1}",),
    "greater_equal": ("fcmp oge {V} {0}, {1}",),
    "equal": ("fcmp oeq {V} {0}, {1}",),
    "not_equal": ("fcmp une {V} {0}, {1}",),
    "logical_and": ("and {B} {0}, {1}",),
    "bitwise_and": ("and {B} {0}, {1}",),
    "logical_or": ("or {B} {0}, {1}",),
    "bitwise_or": ("or {B} {0}, {1}",),
    "logical_not": ("xor {B} {0}, {true}",),
    "invert": ("xor {B} {0}, {true}",),
    "isfinite": ("call {V} @llvm.fabs.{S}({V} {0})", "fcmp olt {V} {a}, {infinity}"),
    "isnan": ("fcmp uno {V} {0}, {0}",),
    "where": ("select {B} {0}, {V} {1}, {V} {2}",),
}
"""What each operation is made of; the last instruction gives the result, ``a`` to ``c`` are those before it."""

_INTRINSICS = ("fabs", "sqrt", "floor", "rint")


def declarations(lanes: int) -> str:
    """What the instructions for so many environments at once take for granted."""
    types = Types(lanes)
    lines = [f"declare {types.real} @llvm.{name}.{types.suffix}({types.real})" for name in _INTRINSICS]
    if lanes > 1:
        lines.append(f"declare i1 @llvm.vector.reduce.and.v{lanes}i1({types.flag})")
    return "\n".join(lines)


class Types:
    """How LLVM calls the numbers of so many environments."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        self.real, self.flag = self.of("double"), self.of("i1")
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"

    def of(self, scalar: str) -> str:
        """The type of such a number in every environment."""
        return scalar if self.lanes == 1 else f"<{self.lanes} x {scalar}>"

    def same(self, scalar: str, literal: str) -> str:
        """A number that is the same in every environment."""
        return literal if self.lanes == 1 else f"<{', '.join([f'{scalar} {literal}'] * self.lanes)}>"
