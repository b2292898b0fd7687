"""Fields of components in the reference: what their declarations say, as if it stood in a docstring below them."""

from __future__ import annotations

import ast
from typing import Any

from griffe import Attribute, Docstring, Extension

_DOC_FIRST = {"quantity", "vector", "count", "option", "flag", "text"}
_DOC_SECOND = {"part", "parts"}
"""Which argument of a declaration (see ``passloc_env.fields``) is its line of documentation."""


class DeclaredFields(Extension):
    """Gives every declared field its line of documentation and its unit, and shows its default alone."""

    def on_attribute_instance(self, *, node: Any, attr: Attribute, **_: Any) -> None:
        """Read the declaration of a field; other attributes stay as they are."""
        call = getattr(node, "value", None)
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name):
            return
        place = 0 if call.func.id in _DOC_FIRST else 1 if call.func.id in _DOC_SECOND else None
        if place is None or len(call.args) <= place:
            return
        words = ast.literal_eval(call.args[place])
        unit = next((ast.literal_eval(word.value) for word in call.keywords if word.arg == "unit"), "")
        attr.docstring = Docstring(f"{words}, {unit}" if unit else words, parent=attr)
        attr.labels -= {"class-attribute", "instance-attribute"}
        attr.value = ast.unparse(call.args[place + 1]) if len(call.args) > place + 1 else None
