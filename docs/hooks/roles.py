"""Sphinx roles of docstrings, ``:class:`~package.Name```, as code that links to its place in the reference."""

from __future__ import annotations

import re
from typing import Any

_ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):<code>(~?)([\w.]+)</code>")


def on_page_content(content: str, **_: Any) -> str:
    """Roles become cross-references; those that lead nowhere remain code."""
    return _ROLE.sub(_reference, content)


def _reference(found: re.Match[str]) -> str:
    tilde, name = found.groups()
    shown = name.rpartition(".")[2] if tilde else name
    return f'<autoref identifier="{name}" optional><code>{shown}</code></autoref>'
