"""What strangers might send: any bytes, any plain data, and whole files with something in them changed.

``FUZZ_EXAMPLES=100000 python -m pytest tests/fuzz`` tries so many of each kind, other ones every time; without it the
same few are tried in every run.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable
from typing import Any, TypeVar

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from passloc_env.errors import InputError

_EXAMPLES = os.environ.get("FUZZ_EXAMPLES")
fuzzed = settings(
    max_examples=int(_EXAMPLES or 60),
    derandomize=_EXAMPLES is None,
    database=None,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)

_T = TypeVar("_T")
_NUMBERS = st.one_of(
    st.integers(-3, 3), st.integers(), st.floats(), st.sampled_from([10**90, -(10**99), 2**63, 1e308, 5e-324, True])
)
_LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    _NUMBERS,
    st.text(),
    st.sampled_from(["Uniform", "Bearing", "inf", "nan", "1e3", "../x", "\x1b[2J", "a\nb", "\ud800", "x" * 300]),
)
PLAIN = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text() | st.just("type"), inner, max_size=4),
    max_leaves=12,
)
"""Any plain data."""

BYTES = st.binary(max_size=200)


@st.composite
def changed_data(draw: st.DrawFn, whole: Any) -> Any:
    """Plain data in which a few values are replaced, removed, doubled or moved."""
    data = copy.deepcopy(whole)
    for _ in range(draw(st.integers(1, 3))):
        place = data
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = draw(st.sampled_from(keys))
            if isinstance(place[key], (dict, list)) and place[key] and draw(st.integers(0, 4)):
                place = place[key]
                continue
            _change(draw, place, key, data)
            break
    return data


def _change(draw: st.DrawFn, place: Any, key: Any, data: Any) -> None:
    action = draw(st.sampled_from(["replace", "replace", "remove", "double", "add", "elsewhere"]))
    if action == "replace":
        place[key] = draw(PLAIN)
    elif action == "remove":
        del place[key]
    elif action == "double" and isinstance(place, list):
        place.insert(key, copy.deepcopy(place[key]))
    elif action == "add" and isinstance(place, dict):
        place[draw(st.text())] = draw(PLAIN)
    else:
        place[key] = copy.deepcopy(draw(st.sampled_from(list(data.values()))))


@st.composite
def changed_bytes(draw: st.DrawFn, whole: bytes) -> bytes:
    """Bytes of which a few are replaced, removed, doubled or cut off."""
    content = bytearray(whole)
    for _ in range(draw(st.integers(1, 4))):
        first = draw(st.integers(0, max(len(content) - 1, 0)))
        length = draw(st.integers(0, 12))
        content[first : first + length] = draw(
            st.one_of(
                st.binary(max_size=12),
                st.just(bytes(content[first : first + 3 * length])),
                st.sampled_from(
                    [b"", b"\x00", b"\xff" * 8, b"[" * 60, b"*a", b"!!python/name:os.system ", b"\n- ", b": "]
                ),
            )
        )
    return bytes(content[: draw(st.sampled_from([len(content), len(content), len(content) // 2]))])


def read_or_refused(read: Callable[[], _T]) -> _T | None:
    """What is read; None when it is refused, in one printable line of an InputError."""
    try:
        return read()
    except InputError as error:
        message = str(error)
        assert 0 < len(message) < 2500
        assert message.isprintable(), message
        return None
