"""Finds out whether another distribution hides one of passloc's packages.

The import names ``agents`` and ``training`` are not passloc's alone: other distributions ship them, and a
plain folder of that name next to a user's script is enough. Python then imports the wrong package and fails
far from the cause, so the command line asks here first.
"""

from __future__ import annotations

import importlib.util
import sys
import warnings
from importlib.machinery import ModuleSpec
from pathlib import Path

OURS = ("agents", "training")
"""Packages of ours whose names others use too."""

MARKER = "passloc"
"""The word in the first line of the docstring of every package that is ours."""


def shadowed(name: str) -> str | None:
    """Returns the path of a foreign package that hides ours, without importing it.

    Args:
        name: Import name of a top-level package.

    Returns:
        The folder or the file that Python would import under this name, or None when it is ours or absent.
    """
    spec = importlib.util.find_spec(name)
    if spec is None or _is_ours(spec):
        return None
    # A namespace package, such as a folder without __init__.py, has folders but no file of its own.
    folders = list(spec.submodule_search_locations or ())
    return folders[0] if folders else str(spec.origin)


def explain(name: str, path: str) -> str:
    """Returns one line that says which package is hidden, by what, and what to do about it.

    Args:
        name: Import name of the hidden package.
        path: Folder or file that hides it, as ``shadowed`` returns it.
    """
    kind = "folder" if Path(path).is_dir() else "file"
    return (
        f"passloc: its package '{name}' is hidden by {path}: install passloc in an environment of its own, "
        f"rename that {kind}, or start from another directory"
    )


def warn_if_shadowed() -> None:
    """Warns, in one line each, about packages of ours that another distribution hides.

    The ``passloc`` command stays silent here, for it refuses to run and says why.
    """
    if Path(sys.argv[0]).stem == MARKER:
        return
    for name in OURS:
        if path := shadowed(name):
            warnings.warn(explain(name, path), stacklevel=3)


def _is_ours(spec: ModuleSpec) -> bool:
    """Tells whether the first line of code of the package, its docstring, holds the marker."""
    # The loader, unlike the file, also reads a package in a zip archive; a namespace package may have none.
    get_source = getattr(spec.loader, "get_source", None)
    if spec.submodule_search_locations is None or get_source is None:
        return False
    try:
        source = get_source(spec.name) or ""
    except (ImportError, SyntaxError, UnicodeDecodeError):
        # Python could not import it either, so it is not the package that passloc installed.
        return False
    code = (line for line in source.splitlines() if line.strip() and not line.startswith("#"))
    return MARKER in next(code, "")
