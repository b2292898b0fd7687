"""Where a result came from: command, versions, machine."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_PACKAGES = ("passloc", "gymnasium", "numpy", "stable-baselines3", "torch", "filterpy", "safetensors")


def provenance(arguments: Sequence[str]) -> dict[str, Any]:
    """The exact command, the versions in use and the machine.

    Args:
        arguments: the command's words, as in ``sys.argv``.
    """
    return {
        "command": command(arguments),
        "versions": {"python": platform.python_version()} | {name: _version(name) for name in _PACKAGES},
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "system": platform.system()},
    }


def same_place(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two provenances are of one machine and the same versions: there results agree to the last bit."""
    return all(one.get(name) == other.get(name) for name in ("versions", "machine"))


def command(arguments: Sequence[str]) -> str:
    """The command as it can be typed again; the program by its name, not by where it happens to lie."""
    program = Path(arguments[0]) if arguments else Path("passloc")
    name = f"python -m {program.parent.name}.{program.stem}" if program.suffix == ".py" else program.name
    return shlex.join([*shlex.split(name), *arguments[1:]])


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()
