"""Infos in Gymnasium's vector form."""

from __future__ import annotations

from typing import Any

import numpy as np

from passloc_env.arrays import BoolArray


class Partial:
    """An info value that only some environments carry."""

    def __init__(self, value: Any, mask: BoolArray) -> None:
        self.value, self.mask = value, mask


def masked(info: dict[str, Any], mask: BoolArray) -> dict[str, Any]:
    """Info in Gymnasium's vector form: a ``_key`` mask beside each key, zeros where an environment has no info."""
    return _masked(info, mask, bool(mask.all()))


def _masked(info: dict[str, Any], mask: BoolArray, everywhere: bool) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in info.items():
        own = mask
        if isinstance(value, Partial):
            value, own = value.value, value.mask
        elif isinstance(value, dict):
            value = _masked(value, mask, everywhere)
        elif not everywhere:
            value = np.where(mask.reshape(-1, *(1,) * (value.ndim - 1)), value, np.zeros((), value.dtype))
        result[key], result[f"_{key}"] = value, own.copy()
    return result
