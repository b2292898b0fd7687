"""A stage in LLVM's assembly: one function for each level, a loop over the environments."""

from __future__ import annotations

from passloc_env.compiled.graph import Node, Value
from passloc_env.compiled.instructions import declarations
from passloc_env.compiled.layout import Home, Layout
from passloc_env.compiled.stage import Stage
from passloc_env.compiled.writer import Place, Writer, is_logical


def assembly(layout: Layout, stage: Stage, lanes: int) -> str:
    """Functions ``level0``, ``level1`` … of a table of rows and a number of environments.

    Each returns whether the guard held in all of them. They take ``lanes`` environments at once, and the last few one
    by one.
    """
    text = [declarations(count) for count in {lanes, 1}]
    last = len(layout.levels) - 1
    for depth in range(len(layout.levels)):
        guard = stage.guard if depth == last else None
        wide, rest = _Loop(layout, depth, "wide", lanes, guard), _Loop(layout, depth, "rest", 1, guard)
        text.append(_function(f"level{depth}", wide, rest))
    return "\n".join(text)


class _Loop:
    """What one level does for some environments at once; the lines of the loop's body."""

    def __init__(self, layout: Layout, depth: int, name: str, lanes: int, guard: Value | None) -> None:
        self.lanes, self.rows = lanes, dict[int, None]()
        self._layout, self._label = layout, name
        self._writer = Writer(lanes, f"{name}.")
        self._index = self._column = f"%index.{name}"
        if layout.column is not None:
            self._column = self._writer.index(Place(self._row(layout.column.row), "i64", self._index))
        self._names: dict[int, str] = {}
        level, stores = layout.levels[depth], layout.stores[depth]
        ready: dict[int, list[tuple[Home, Value]]] = {}
        late = layout.in_place and depth == len(layout.levels) - 1
        for home, value in stores:
            ready.setdefault(id(value), []).append((home, value))
        for node in level.plain:
            self._names[id(node)] = self._result(node, [self._name(operand) for operand in node.operands])
            if not late:
                self._store(ready.pop(id(node), []))
        self._store([store for group in ready.values() for store in group])
        if guard is not None:
            self._writer.require(self._name(guard), "%met")

    def around(self, first: str, end: str, after: str) -> list[str]:
        """The loop from one environment to before another; ``after`` is where it goes on."""
        label, index = self._label, f"%index.{self._label}"
        return [
            f"before.{label}:",
            f"%any.{label} = icmp ult i64 {first}, {end}",
            f"br i1 %any.{label}, label %{label}, label %{after}",
            f"{label}:",
            f"{index} = phi i64 [{first}, %before.{label}], [%next.{label}, %{label}]",
            *self._writer.lines,
            f"%next.{label} = add i64 {index}, {self.lanes}",
            f"%more.{label} = icmp ult i64 %next.{label}, {end}",
            f"br i1 %more.{label}, label %{label}, label %{after}",
        ]

    def _store(self, stores: list[tuple[Home, Value]]) -> None:
        """All of these have been read before the first is written: they may be rows of one another."""
        named = [(self._name(value), home, value) for home, value in stores]
        for name, home, value in named:
            self._writer.store(name, is_logical(value), self._place(home))

    def _result(self, node: Node, operands: list[str]) -> str:
        table, first = self._layout.tables.get(id(node)), self._layout.first
        if table is None or first is None:
            return self._writer.apply(node, operands)
        return self._writer.look_up(self._row(table.row), table.pitch, self._place(first), operands[0])

    def _place(self, home: Home) -> Place:
        """Where a row is read or written: of scratch rows the next entries, of the others those that are meant."""
        fixed = home.row < self._layout.fixed
        return Place(self._row(home.row), home.kind, self._column if fixed else self._index)

    def _row(self, row: int) -> str:
        self.rows[row] = None
        return f"%row{row}"

    def _name(self, value: Value) -> str:
        if not isinstance(value, Node):
            return self._writer.constant(value)
        if id(value) not in self._names:
            self._names[id(value)] = self._writer.load(self._place(self._layout.homes[id(value)]), value.logical)
        return self._names[id(value)]


def _function(name: str, wide: _Loop, rest: _Loop) -> str:
    """A loop for many environments at once, then one for those that are left."""
    lines = [f"define zeroext i1 @{name}(ptr %rows, i64 %count) nounwind {{", "start:"]
    for row in wide.rows | rest.rows:
        lines.append(f"%place{row} = getelementptr ptr, ptr %rows, i64 {row}")
        lines.append(f"%row{row} = load ptr, ptr %place{row}, align 8")
    lines += ["%met = alloca i1", "store i1 true, ptr %met", f"%whole = and i64 %count, {-wide.lanes}"]
    lines += ["br label %before.wide", *wide.around("0", "%whole", "before.rest")]
    lines += [*rest.around("%whole", "%count", "end")]
    return "\n".join([*lines, "end:", "%held = load i1, ptr %met", "ret i1 %held", "}"])
