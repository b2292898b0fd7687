"""Changing any field of a scenario by its dotted name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from passloc_env.component import Component, specs
from passloc_env.errors import ScenarioError, one_line, unknown_name


def override(component: Component, changes: Mapping[str, Any]) -> Component:
    """A copy of ``component`` with fields replaced by dotted name, all of them checked together.

    Raises:
        ScenarioError: a name that does not exist (with the closest one), or a value that is not allowed.
    """
    tree: dict[str, Any] = {}
    for name, value in changes.items():
        *path, leaf = str(name).split(".")
        for depth in range(1, len(path) + 1):
            above = ".".join(path[:depth])
            if above in changes:
                raise ScenarioError(str(name), value, f"{one_line(above)} is already replaced as a whole")
        branch = tree
        for key in path:
            branch = branch.setdefault(key, {})
        branch[leaf] = _Leaf(value)
    return _apply(component, tree, "")


@dataclasses.dataclass
class _Leaf:
    value: Any


def _apply(component: Component, tree: Mapping[str, Any], path: str) -> Component:
    known = specs(type(component))
    fields: dict[str, Any] = {}
    for key, change in tree.items():
        if key not in known:
            given = change.value if isinstance(change, _Leaf) else key
            raise unknown_name(path + key, given, known, f"field of {type(component).__name__}", name=key)
        current = getattr(component, key)
        fields[key] = change.value if isinstance(change, _Leaf) else _inside(current, change, f"{path}{key}.")
    try:
        return dataclasses.replace(component, **fields)  # type: ignore[type-var]
    except ScenarioError as error:
        raise ScenarioError(path + error.field, error.value, error.allowed) from None


def _inside(current: Any, tree: Mapping[str, Any], path: str) -> Any:
    if isinstance(current, Component):
        return _apply(current, tree, path)
    if isinstance(current, tuple):
        items = list(current)
        for key, change in tree.items():
            index = _index(items, key, path)
            replaced = change.value if isinstance(change, _Leaf) else _inside(items[index], change, f"{path}{key}.")
            items[index] = replaced
        return tuple(items)
    raise unknown_name(path[:-1], next(iter(tree)), (), f"field inside {current!r}")


def _index(items: list[Any], key: str, path: str) -> int:
    """The position of a list item named by number or by class name."""
    if key.isascii() and key.isdigit() and int(key) < len(items):
        return int(key)
    names = [type(item).__name__ for item in items]
    if names.count(key) == 1:
        return names.index(key)
    if key in names:
        numbers = ", ".join(str(i) for i, name in enumerate(names) if name == key)
        raise ScenarioError(path + key, key, f"there are several {key}; name one by number: {numbers}")
    valid = [str(i) for i in range(len(items))] + [n for n in names if names.count(n) == 1 and n != "float"]
    raise unknown_name(path + key, key, valid, "list item")
