"""Writing files that others may read, or that a run cut short may leave behind."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

_SHOWN = 5
_saved: list[Path] = []


def json_text(data: Any) -> str:
    """Plain data as JSON, with null for what is not a finite number, which JSON does not know."""
    return json.dumps(_finite(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that appears whole or not at all; text as UTF-8."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content.encode() if isinstance(content, str) else content)
    partial.replace(path)
    note(path)


def note(path: Path) -> None:
    """Remember that a file, or a folder of them, is whole: who interrupts a command is told."""
    if path not in _saved:
        _saved.append(path)


def saved() -> list[str]:
    """What this process has saved; of many files the folders."""
    if len(_saved) <= _SHOWN:
        return [str(path) for path in _saved]
    folders = dict.fromkeys(str(path.parent) for path in _saved)
    return [f"{sum(str(path.parent) == folder for path in _saved)} files in {folder}" for folder in folders]


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
