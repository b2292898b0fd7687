"""Reading what strangers may have written: regular files of bounded size, and plain data of bounded depth.

Whatever is wrong is said in one line, before much time or memory has gone into it; nothing that is read is ever run.
"""

from __future__ import annotations

import errno
import json
import math
import os
import stat
from collections import Counter
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from passloc_env.errors import InputError, one_line, shown

TEXT_LIMIT = 1 << 20
"""Bytes that a text file may hold: a hundred times the largest scenario or card."""

_DEPTH = 50
_ITEMS = 50_000
_DIGITS = 100
"""How deeply plain data may be nested, how many values it usually may hold, and how long its whole numbers may be."""

_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
"""What YAML calls whole and other numbers."""


def open_regular(path: Path) -> BinaryIO:
    """A file opened for reading; never a folder, a pipe or a device, which might have no end.

    Raises:
        OSError: it cannot be opened, or is no regular file.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "not a path", str(path))
    # Without waiting, for a pipe that nobody writes into would open only when somebody does.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    return os.fdopen(descriptor, "rb")


def read_bytes(path: Path, limit: int) -> bytes:
    """The content of a regular file.

    Args:
        path: of the file.
        limit: bytes that it may hold.

    Raises:
        OSError: it cannot be opened, is no regular file, or is larger.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise OSError(errno.EFBIG, f"larger than the {limit >> 10} KiB that such a file may have", str(path))
        return file.read(size)


def read_text(path: Path) -> str:
    """The text of a regular file of at most :data:`TEXT_LIMIT` bytes.

    Raises:
        OSError: as :func:`read_bytes`.
        InputError: bytes that are not UTF-8.
    """
    try:
        return read_bytes(path, TEXT_LIMIT).decode()
    except UnicodeDecodeError:
        raise InputError("not a text in UTF-8") from None


def json_data(text: str, items: int = _ITEMS) -> Any:
    """Plain data from JSON text, strictly: every name once in its object, and only numbers that JSON knows.

    Args:
        text: the JSON.
        items: values that it may hold.

    Raises:
        InputError: another text, or one that is nested too deeply or holds too much.
    """
    try:
        data = json.loads(text, object_pairs_hook=_unique, parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise InputError(f"nested more than {_DEPTH} deep") from None
    except ValueError as error:
        raise InputError(one_line(error)) from None
    _check(data, items)
    return data


def yaml_data(text: str) -> Any:
    """Plain data from YAML text, strictly: no objects of Python, and every name once in its mapping.

    Raises:
        InputError: another text, or one that is nested too deeply or holds too much.
    """
    try:
        data = yaml.load(text, _PlainLoader)
    except InputError:
        raise
    except (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # PyYAML's own constructors of numbers and dates fail each in its way.
        raise InputError(one_line(error)) from None
    _check(data, _ITEMS)
    return data


class _PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader, that neither follows aliases into the endless nor counts to base 60.

    An alias costs a few letters and stands for as much as one likes, itself even; so each node is counted as often as
    it is meant, while the text is read. ``1:30`` is a text here, as in YAML 1.2, and not the number 90: a long one
    would take time that grows with the square of its length.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth, self._items = 0, 0
        self._sizes: dict[yaml.Node, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """The next node; InputError when there have been too many, too deep, or one inside itself."""
        alias = self.check_event(yaml.AliasEvent)
        before = self._items
        self._depth += 1
        if self._depth > _DEPTH:
            raise InputError(f"nested more than {_DEPTH} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is None:
            return None
        if alias and node not in self._sizes:
            raise InputError("an alias stands inside what it stands for")
        self._items += self._sizes[node] if alias else 1
        self._sizes.setdefault(node, self._items - before)
        if self._items > _ITEMS:
            raise InputError(f"more than {_ITEMS} values")
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """A mapping; InputError for a name that stands there twice, where the last would win unsaid."""
        node = super().compose_mapping_node(anchor)
        names = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        for name, times in names.most_common(1):
            if times > 1:
                raise InputError(f"{shown(name)} stands there twice")
        return node

    def resolve(self, kind: type[yaml.Node], value: Any, implicit: Any) -> str:
        """The tag of a node that bears none."""
        tag: str = super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]
        return self.DEFAULT_SCALAR_TAG if tag in _NUMBERS and ":" in value else tag

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        """The text of a scalar; InputError for one to base 60 that its tag calls a number."""
        text = super().construct_scalar(node)
        if node.tag in _NUMBERS and ":" in text:
            raise InputError(f"{shown(text)} is no number")
        return text


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON; ValueError for a name that stands there twice, where the last would win unsaid."""
    data: dict[str, Any] = {}
    for name, value in pairs:
        if name in data:
            raise ValueError(f"{shown(name)} stands there twice")
        data[name] = value
    return data


def _finite(text: str) -> float:
    """A number of JSON; ValueError for one that is none, or beyond all floats."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{shown(text)} is no finite number")
    return number


def _check(data: Any, most: int) -> None:
    """InputError for plain data that is nested too deeply, holds too much, or what cannot be written again."""
    level, items = [data], 0
    for _ in range(_DEPTH):
        items += len(level)
        if items > most:
            raise InputError(f"more than {most} values")
        inner: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                inner += [*value, *value.values()]
            elif isinstance(value, (list, tuple, set)):
                inner += value
            elif isinstance(value, int) and abs(value) >= 10**_DIGITS:
                raise InputError(f"a whole number of more than {_DIGITS} digits")
            elif isinstance(value, str) and not value.isascii():
                _check_text(value)
        level = inner
        if not level:
            return
    raise InputError(f"nested more than {_DEPTH} deep")


def _check_text(text: str) -> None:
    """InputError for half of a surrogate pair, which no file can hold."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InputError(f"{shown(text)} holds half a character") from None
