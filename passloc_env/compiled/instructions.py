"""Operations on numbers in LLVM's assembly, for one environment or for several at once.

No instruction may be fused with another or put in another order: LLVM does neither unless it is told to. So every
number is the one that NumPy computes.
"""

from __future__ import annotations

import struct

from passloc_env.compiled.graph import Node, Value

INSTRUCTIONS: dict[str, tuple[str, ...]] = {
    "add": ("fadd {V} {0}, {1}",),
    "subtract": ("fsub {V} {0}, {1}",),
    "multiply": ("fmul {V} {0}, {1}",),
    "divide": ("fdiv {V} {0}, {1}",),
    "negative": ("fneg {V} {0}",),
    "square": ("fmul {V} {0}, {0}",),
    "absolute": ("call {V} @llvm.fabs.{S}({V} {0})",),
    "sqrt": ("call {V} @llvm.sqrt.{S}({V} {0})",),
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

_LOGICAL = {"logical_and", "bitwise_and", "logical_or", "bitwise_or", "logical_not", "invert"}
"""Operations on truth values; a choice takes one, and numbers."""

_INTRINSICS = ("fabs", "sqrt", "rint")


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


class Writer:
    """Lines of assembly for the environments from ``index`` on; every value gets a name of its own.

    Args:
        lanes: how many environments at once.
        index: name of the first one's number.
        prefix: what the names begin with.
    """

    def __init__(self, lanes: int, index: str, prefix: str) -> None:
        self.types, self.lines = Types(lanes), list[str]()
        self._index, self._prefix, self._count = index, prefix, 0

    def put(self, instruction: str) -> str:
        """Add an instruction; returns the name of its result."""
        self._count += 1
        name = f"%{self._prefix}{self._count}"
        self.lines.append(f"{name} = {instruction}")
        return name

    def load(self, pointer: str, kind: str, logical: bool) -> str:
        """The values of a row of ``double``, ``i64`` or ``i8``, as numbers or as truth values."""
        types = self.types
        place = self.put(f"getelementptr {kind}, ptr {pointer}, i64 {self._index}")
        value = self.put(f"load {types.of(kind)}, ptr {place}, align {_bytes(kind)}")
        if kind == "i8":
            return self.put(f"icmp ne {types.of(kind)} {value}, {types.same(kind, '0')}")
        if kind == "i64":
            return self.put(f"sitofp {types.of(kind)} {value} to {types.real}")
        return self.truth(value, logical=False) if logical else value

    def gather(self, pointer: str, places: str, pitch: int) -> str:
        """Numbers from anywhere: each environment's own multiple of ``pitch``, in a row of ``i64``, tells where."""
        types, whole = self.types, self.types.of("i64")
        first = self.put(f"getelementptr i64, ptr {places}, i64 {self._index}")
        offset = self.put(
            f"mul {whole} {self.put(f'load {whole}, ptr {first}, align 8')}, {types.same('i64', str(pitch))}"
        )
        if types.lanes == 1:
            return self.put(
                f"load double, ptr {self.put(f'getelementptr double, ptr {pointer}, i64 {offset}')}, align 8"
            )
        gathered = "poison"
        for lane in range(types.lanes):
            own = self.put(f"extractelement {whole} {offset}, i32 {lane}")
            place = self.put(f"getelementptr double, ptr {pointer}, i64 {own}")
            number = self.put(f"load double, ptr {place}, align 8")
            gathered = self.put(f"insertelement {types.real} {gathered}, double {number}, i32 {lane}")
        return gathered

    def store(self, value: str, logical: bool, pointer: str, kind: str) -> None:
        """Put numbers or truth values away in a row."""
        types, held = self.types, self.types.of(kind)
        if kind == "i8":
            value = self.put(f"zext {types.flag} {value} to {held}")
        else:
            value = self.number(value, logical)
            value = self.put(f"fptosi {types.real} {value} to {held}") if kind == "i64" else value
        place = self.put(f"getelementptr {kind}, ptr {pointer}, i64 {self._index}")
        self.lines.append(f"store {held} {value}, ptr {place}, align {_bytes(kind)}")

    def require(self, value: str, pointer: str) -> None:
        """Note in a flag where a truth value does not hold in all environments."""
        types, before = self.types, self.put(f"load i1, ptr {pointer}")
        whole = (
            self.put(f"call i1 @llvm.vector.reduce.and.v{types.lanes}i1({types.flag} {value})")
            if types.lanes > 1
            else value
        )
        self.lines.append(f"store i1 {self.put(f'and i1 {before}, {whole}')}, ptr {pointer}")

    def number(self, value: str, logical: bool) -> str:
        """A value as a number."""
        return self.put(f"uitofp {self.types.flag} {value} to {self.types.real}") if logical else value

    def truth(self, value: str, logical: bool) -> str:
        """A value as a truth value."""
        return value if logical else self.put(f"fcmp une {self.types.real} {value}, {self.constant(0.0)}")

    def constant(self, value: float | bool) -> str:
        """A truth value or a number, to the last bit."""
        if isinstance(value, bool):
            return self.types.same("i1", str(value).lower())
        bits = struct.unpack("<Q", struct.pack("<d", float(value)))[0]
        return self.types.same("double", f"0x{bits:016X}")

    def apply(self, node: Node, operands: list[str]) -> str:
        """An operation of the graph on values that have been named before."""
        types = self.types
        given = [
            (self.truth if _takes_flag(node.name, position) else self.number)(name, is_logical(operand))
            for position, (name, operand) in enumerate(zip(operands, node.operands, strict=True))
        ]
        words = {"V": types.real, "B": types.flag, "S": types.suffix}
        words |= {"true": self.constant(True), "infinity": self.constant(float("inf"))}
        for letter, template in zip("abcd", INSTRUCTIONS[node.name], strict=False):
            words[letter] = result = self.put(template.format(*given, **words))
        return result


def is_logical(value: Value) -> bool:
    """Whether an operand is a truth value."""
    return value.logical if isinstance(value, Node) else isinstance(value, bool)


def _takes_flag(name: str, position: int) -> bool:
    return name in _LOGICAL or (name == "where" and position == 0)


def _bytes(kind: str) -> int:
    return 1 if kind == "i8" else 8
