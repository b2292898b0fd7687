"""Whether plain data that was read is built as data that is known: the same names, lengths, types and shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def check_like(found: Any, like: Any, name: str) -> None:
    """Compare two trees of mappings, lists, arrays and plain data.

    Texts must be the same; whole numbers at least 0; numbers finite; where one is None the other may be a number.

    Args:
        found: what was read.
        like: what it should be built like.
        name: of the tree, for the message.

    Raises:
        ValueError: they differ; the message names the branch.
    """
    if isinstance(like, dict):
        if not isinstance(found, dict) or found.keys() != like.keys():
            raise ValueError(f"{name} does not hold {', '.join(map(str, like)) or 'nothing'}")
        for key, value in like.items():
            check_like(found[key], value, f"{name}.{key}")
    elif isinstance(like, list | tuple):
        if not isinstance(found, list | tuple) or len(found) != len(like):
            raise ValueError(f"{name} is not a list of {len(like)}")
        for index, value in enumerate(like):
            check_like(found[index], value, f"{name}.{index}")
    elif isinstance(like, np.ndarray):
        if not isinstance(found, np.ndarray) or (found.dtype, found.shape) != (like.dtype, like.shape):
            raise ValueError(f"{name} is not an array {like.shape} of {like.dtype}")
    elif not _same_kind(found, like):
        raise ValueError(f"{name} is not possible")


def _same_kind(found: Any, like: Any) -> bool:
    kind = type(like.item() if isinstance(like, np.generic) else like)
    if kind is str:
        return bool(found == like)
    if type(found) is float:
        return math.isfinite(found) and kind in (float, type(None))
    return type(found) is kind and (kind is not int or found >= 0)
