"""Writing a loop's body in LLVM's assembly."""

from __future__ import annotations

import struct
from typing import NamedTuple

from passloc_env.compiled.graph import Node, Value
from passloc_env.compiled.instructions import INSTRUCTIONS, Types

_LOGICAL = {"logical_and", "bitwise_and", "logical_or", "bitwise_or", "logical_not", "invert"}
"""Operations on truth values; a choice takes one, and numbers."""


class Place(NamedTuple):
    """Where in a row of ``double``, ``i64`` or ``i8`` the values of some environments begin."""

    pointer: str
    kind: str
    start: str


class Writer:
    """Lines of assembly for so many environments at once; every result gets a name, which begins with ``prefix``."""

    def __init__(self, lanes: int, prefix: str) -> None:
        self.types, self.lines = Types(lanes), list[str]()
        self._prefix, self._count = prefix, 0

    def put(self, instruction: str) -> str:
        """Add an instruction; returns the name of its result."""
        self._count += 1
        name = f"%{self._prefix}{self._count}"
        self.lines.append(f"{name} = {instruction}")
        return name

    def load(self, place: Place, logical: bool) -> str:
        """The values of a row, as numbers or as truth values."""
        types, held = self.types, self.types.of(place.kind)
        value = self._loaded(place)
        if place.kind == "i8":
            return self.put(f"icmp ne {held} {value}, {types.same('i8', '0')}")
        if place.kind == "i64":
            return self.put(f"sitofp {held} {value} to {types.real}")
        return self.truth(value, logical=False) if logical else value

    def index(self, place: Place) -> str:
        """The index that stands in a row for a single environment."""
        return self.put(f"load i64, ptr {self._address(place)}, align 8")

    def look_up(self, table: str, pitch: int, first: Place, step: str) -> str:
        """Each environment's number at its step; a table holds ``pitch`` numbers for each step, ``first`` is step 0."""
        types, whole = self.types, self.types.of("i64")
        ahead = self.put(f"fptosi {types.real} {step} to {whole}")
        cell = self.put(f"add {whole} {self._loaded(first)}, {ahead}")
        offset = self.put(f"mul {whole} {cell}, {types.same('i64', str(pitch))}")
        if types.lanes == 1:
            return self._loaded(Place(table, "double", offset))
        gathered = "poison"
        for lane in range(types.lanes):
            own = self.put(f"extractelement {whole} {offset}, i32 {lane}")
            address = self._address(Place(table, "double", own))
            number = self.put(f"load double, ptr {address}, align 8")
            gathered = self.put(f"insertelement {types.real} {gathered}, double {number}, i32 {lane}")
        return gathered

    def store(self, value: str, logical: bool, place: Place) -> None:
        """Put numbers or truth values away in a row."""
        types, held = self.types, self.types.of(place.kind)
        if place.kind == "i8":
            value = self.put(f"zext {types.flag} {self.truth(value, logical)} to {held}")
        else:
            value = self.number(value, logical)
            value = self.put(f"fptosi {types.real} {value} to {held}") if place.kind == "i64" else value
        self.lines.append(f"store {held} {value}, ptr {self._address(place)}, align {_bytes(place.kind)}")

    def require(self, value: str, flag: str) -> None:
        """Lower a flag where a truth value does not hold in all environments."""
        types, before = self.types, self.put(f"load i1, ptr {flag}")
        if types.lanes > 1:
            value = self.put(f"call i1 @llvm.vector.reduce.and.v{types.lanes}i1({types.flag} {value})")
        self.lines.append(f"store i1 {self.put(f'and i1 {before}, {value}')}, ptr {flag}")

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

    def _loaded(self, place: Place) -> str:
        return self.put(f"load {self.types.of(place.kind)}, ptr {self._address(place)}, align {_bytes(place.kind)}")

    def _address(self, place: Place) -> str:
        return self.put(f"getelementptr {place.kind}, ptr {place.pointer}, i64 {place.start}")


def is_logical(value: Value) -> bool:
    """Whether an operand is a truth value."""
    return value.logical if isinstance(value, Node) else isinstance(value, bool)


def _takes_flag(name: str, position: int) -> bool:
    return name in _LOGICAL or (name == "where" and position == 0)


def _bytes(kind: str) -> int:
    return 1 if kind == "i8" else 8
