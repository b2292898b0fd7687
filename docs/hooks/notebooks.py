"""Notebooks as pages: their text, code and committed outputs, in the style of all other pages."""

from __future__ import annotations

import base64
import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel

_ENDING = ".ipynb"
_LINK = re.compile(r"\]\(([^)]+)\.ipynb\)(?!\{)")
"""A link to a notebook; one with attributes is a download."""
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Put a page and its pictures beside every notebook; the notebook stays, to be downloaded."""
    for notebook in [file for file in files if file.src_uri.endswith(_ENDING)]:
        notebook.inclusion = InclusionLevel.INCLUDED
        stem = notebook.src_uri.removesuffix(_ENDING)
        parts: list[str] = []
        pictures = itertools.count()
        for cell in json.loads(notebook.content_string)["cells"]:
            parts.append(_text(cell) if cell["cell_type"] == "markdown" else _code(cell))
            for kind, shown in _outputs(cell):
                if kind == "picture":
                    name = f"{stem}_{next(pictures)}.png"
                    files.append(File.generated(config, name, content=base64.b64decode(shown)))
                    parts.append(f"![Output]({Path(name).name})")
                else:
                    parts.append(f"```{{ .text .output }}\n{shown.rstrip()}\n```")
        title, *others = parts
        download = f"[Download this notebook]({Path(notebook.src_uri).name}){{ .md-button download }}"
        page = "\n\n".join([title, download, *others]) + "\n"
        files.append(File.generated(config, f"{stem}.md", content=page))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links to notebooks, which lead to them in the repository, lead to their pages here."""
    return _LINK.sub(r"](\1.md)", markdown)


def _text(cell: dict[str, Any]) -> str:
    """A cell of text, whose links to notebooks lead to their pages."""
    return _LINK.sub(r"](\1.md)", "".join(cell["source"]))


def _code(cell: dict[str, Any]) -> str:
    return f"```python\n{''.join(cell['source'])}\n```"


def _outputs(cell: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """What a cell has shown: pictures (base64) and text."""
    for output in cell.get("outputs", ()):
        data = output.get("data", {})
        if "image/png" in data:
            yield "picture", "".join(data["image/png"])
        elif text := output.get("text") or data.get("text/plain"):
            yield "text", _COLOUR.sub("", "".join(text))
