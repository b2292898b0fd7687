"""Reproductions as files: one JSON per paper, all claims in one list, and a page that shows everything."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from passloc_env.errors import InputError
from passloc_env.reading import json_data, read_text
from training.files import json_text, write_whole
from training.markdown import markdown
from training.papers.catalogue import PAPERS, Paper
from training.papers.reproduction import Reproduction

_KEYS = {"command", "claims", "figures", "tables"}
"""What a page needs of a paper's file."""

_HEAD = """# Five papers, claim by claim

Each paper studies passive localisation from fixed stations. Its simulations run here in the environment itself, with
nobody at the helm, and every claim is put beside what came out: *reproduced*, *reproduced-if* a condition holds that
the paper does not state, or *not-reproducible*, with the measured reason. Where a fixed station is blind, a table sets
it beside observers that move. `passloc reproduce all --out FOLDER` writes all of it; each part names its own command.
"""


def save(reproduction: Reproduction, folder: Path, command: str) -> None:
    """Write what a reproduction came to, and the command that made it, as ``PAPER.json``."""
    data = {"command": command, **reproduction.to_dict()}
    write_whole(folder / f"{reproduction.paper}.json", json_text(data))


def check_others(folder: Path, replaced: Sequence[Paper]) -> None:
    """See that what a folder holds of papers other than those to be replaced can be read; errors as :func:`collect`."""
    for paper in PAPERS.values():
        if paper not in replaced:
            _read(folder / f"{paper.name}.json")


def collect(folder: Path) -> list[Path]:
    """Write ``claims.json`` and ``index.md`` from the papers found in a folder; what was written.

    Raises:
        InputError: a paper's file that cannot be read.
    """
    found = [(paper, _read(folder / f"{paper.name}.json")) for paper in PAPERS.values()]
    present = [(paper, data) for paper, data in found if data is not None]
    claims, page = folder / "claims.json", folder / "index.md"
    write_whole(claims, json_text([claim for _, data in present for claim in data["claims"]]))
    sections = [_section(paper, data) for paper, data in present]
    write_whole(page, "\n".join([_HEAD, _summary(present), *sections]))
    return [claims, page]


def _summary(present: Sequence[tuple[Paper, dict[str, Any]]]) -> str:
    rows = []
    for paper, data in present:
        verdicts = [claim["verdict"] for claim in data["claims"]]
        counts = [str(verdicts.count(verdict)) for verdict in ("reproduced", "reproduced-if", "not-reproducible")]
        rows.append([f"[{paper.name}](#{paper.name})", paper.subject, *counts])
    return _table(["paper", "subject", "reproduced", "reproduced-if", "not-reproducible"], rows)


def _section(paper: Paper, data: dict[str, Any]) -> str:
    claims = [
        [
            claim["claim"],
            _text(claim["paper_value"]),
            _text(claim["measured"]) + _interval(claim["interval"]),
            claim["assumption"],
            f"**{claim['verdict']}**",
        ]
        for claim in data["claims"]
    ]
    parts = [f"## {paper.name}", f"Paper {paper.number}: {paper.citation}", f"```sh\n{data['command']}\n```"]
    if data.get("caution"):
        parts.append(f"*{data['caution']}*")
    parts.append(_table(["claim", "paper", "measured [95 %]", "assumption", "verdict"], claims))
    for table in data["tables"]:
        parts += [f"### {table['title']}", _table(table["headings"], table["rows"])]
    for figure in data["figures"]:
        parts.append(f"![{figure['caption']}]({figure['file']})\n\n*{figure['caption']}*\n")
    return "\n\n".join(parts)


def _text(value: float | str | None) -> str:
    return "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"


def _interval(interval: Sequence[float | None] | None) -> str:
    return "" if interval is None else f" [{_text(interval[0])}, {_text(interval[1])}]"


def _read(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    advice = "reproduce that paper again, or remove the file"
    try:
        data = json_data(read_text(path))
    except ValueError:
        raise InputError(f"{path} is not readable JSON: {advice}") from None
    if not isinstance(data, dict) or not data.keys() >= _KEYS:
        raise InputError(f"{path} does not hold a paper's results: {advice}")
    return data


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose cells, which the papers' words are in, may hold the sign that parts columns."""
    escaped = [[cell.replace("|", "\\|") for cell in line] for line in (headings, *rows)]
    return markdown(escaped[0], escaped[1:]) + "\n"
