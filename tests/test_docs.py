"""The documentation: its examples run, its links lead somewhere, its notebooks show what they would show today."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from markdown_blocks import ROOT, blocks, run

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
NOTEBOOKS = sorted(DOCS.rglob("*.ipynb"))
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)[^)]*\)")
NUMBER = re.compile(r"[-+]?\d[\d.]*")

needs_docs = pytest.mark.skipif(importlib.util.find_spec("mkdocs") is None, reason="needs the extra docs")


def name(path: Path) -> str:
    """A page as the navigation names it."""
    return path.relative_to(DOCS).with_suffix(".md").as_posix()


def leaves(nav: Any) -> Iterator[str]:
    """Every page of a navigation."""
    if isinstance(nav, str):
        yield nav
    else:
        for item in nav.values() if isinstance(nav, dict) else nav:
            yield from leaves(item)


@pytest.mark.parametrize(
    ("page", "index"),
    [(page, index) for page in PAGES for index in range(len(blocks(page)))],
    ids=lambda value: name(value) if isinstance(value, Path) else str(value),
)
def test_example_runs_as_written(page: Path, index: int, tmp_path: Path) -> None:
    run(blocks(page)[index], tmp_path)


@pytest.mark.parametrize("guide", ["own_scenario", "own_sensor", "own_tracker", "own_policy"])
def test_a_guide_makes_one_and_flies_it(guide: str) -> None:
    first = [block for block in blocks(DOCS / "guides" / f"{guide}.md") if "evaluate(" in block]
    assert first, "no example is flown"


def test_every_page_is_in_the_navigation() -> None:
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    listed = list(leaves(nav))
    assert len(listed) == len(set(listed))
    assert set(listed) == {name(path) for path in (*PAGES, *NOTEBOOKS)}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_and_pictures_exist(page: Path) -> None:
    """Within the documentation; a notebook stands for its page."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in LINK.findall(re.sub(r"`[^`\n]*`", "", text)):
        if re.match(r"[a-z]+:", target):
            continue
        path = page.parent / target.partition("#")[0] if not target.startswith("#") else page
        assert path.resolve().is_relative_to(DOCS), f"{target} leads out of the documentation"
        assert path.exists() or path.with_suffix(".ipynb").exists(), f"{target} does not exist"


@needs_docs
@pytest.mark.parametrize("path", NOTEBOOKS, ids=name)
def test_a_notebook_shows_what_it_showed(path: Path, tmp_path: Path) -> None:
    """Executed again, every cell has outputs of the same kinds with the same words; numbers may differ by machine."""
    nbformat = pytest.importorskip("nbformat")
    spec = importlib.util.spec_from_file_location("execute_notebooks", DOCS / "hooks" / "execute_notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    committed, fresh = nbformat.read(path, as_version=4), hook.executed(path, tmp_path)
    for before, now in zip(committed.cells, fresh.cells, strict=True):
        assert shown(now) == shown(before)
        assert not any(output.get("name") == "stderr" for output in now.get("outputs", ()))
    assert str(Path.home()) not in path.read_text(encoding="utf-8")
    assert path.stat().st_size < 250_000


def shown(cell: Any) -> list[tuple[str, ...]]:
    """The kinds of a cell's outputs, and the words of what it printed."""
    return [
        (output["output_type"], *sorted(output.get("data", ())), *NUMBER.sub(" 0 ", output.get("text", "")).split())
        for output in cell.get("outputs", ())
    ]


@needs_docs
def test_the_site_builds_and_asks_for_nothing_from_elsewhere(tmp_path: Path) -> None:
    """Strictly: a link, an anchor or a page of the navigation that does not exist stops the build."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    pages = {path.relative_to(tmp_path).as_posix(): path.read_text("utf-8") for path in tmp_path.rglob("*.html")}
    for where, page in pages.items():
        outside = re.findall(r'<(?:script|img|iframe|source)[^>]*src="(?:https?:)?//[^"]+"', page)
        outside += re.findall(r'<link[^>]*rel="(?:stylesheet|preconnect)"[^>]*href="(?:https?:)?//[^"]+"', page)
        assert not outside, f"{where} loads {outside}"
        assert "arithmatex" not in page, f"{where} has a formula that was not drawn"
        assert not re.search(r":(?:class|func|meth|attr|data|mod):", page), f"{where} has a role of Sphinx"
    assert pages["observability.html"].count("<math") > 20
    assert "Bearing.sigma" in pages["reference/observers.html"]
    assert "<img" in pages["notebooks/first_flight.html"]
