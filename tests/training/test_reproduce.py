"""``passloc reproduce``: papers by name, files claim by claim, and a page that leaves nothing out."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from passloc_env.errors import InputError
from training.papers.catalogue import PAPERS, find_papers
from training.papers.reproduction import Reproduction, Verdict, holds
from training.statistics import Estimate

Said = tuple[int, str, str]
Passloc = Callable[..., Said]
KEYS = ["paper", "claim", "paper_value", "measured", "interval", "assumption", "verdict"]
VERDICTS = {"reproduced", "reproduced-if", "not-reproducible"}


def pretend(reproduction: Reproduction) -> None:
    """A paper of one figure, one table and claims of every kind, whose numbers hang on seed and runs alone."""
    runs = reproduction.runs_or(50)
    values = np.random.default_rng(reproduction.seed).normal(size=runs)
    mean, paper = float(values.mean()), reproduction.paper
    reproduction.claim(f"{paper} in words | with a bar", "yes", "it does", Verdict.REPRODUCED)
    reproduction.claim(
        f"{paper} in numbers", 0.125, mean, holds(mean > 9.0), f"{runs} runs", interval=(mean - 1.0, mean + 1.0)
    )
    estimate = Estimate(12345.678, 12000.0, 13000.0)
    reproduction.claim(f"{paper} estimated", "≈ 1.2e4", estimate, Verdict.REPRODUCED_IF, "if so")
    reproduction.claim(f"{paper} diverging", 1.0, math.nan, Verdict.NOT_REPRODUCIBLE)
    reproduction.table(f"Numbers of {paper}", ("run", "value"), [("0", f"{values[0]:.6f}"), ("|", "–")])
    with reproduction.figure("curve", f"A curve of {paper}") as axes:
        axes.plot(values)


@pytest.fixture
def pretended(monkeypatch: pytest.MonkeyPatch) -> None:
    """All papers are made up."""
    for name in PAPERS:
        module = importlib.import_module(f"training.papers.{name.replace('-', '_')}")
        monkeypatch.setattr(module, "reproduce", pretend)


@pytest.fixture
def no_papers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may be run."""

    def forbidden(reproduction: Reproduction) -> None:
        raise AssertionError(f"{reproduction.paper} was run")

    for name in PAPERS:
        module = importlib.import_module(f"training.papers.{name.replace('-', '_')}")
        monkeypatch.setattr(module, "reproduce", forbidden)


def claims_in(folder: Path) -> list[dict[str, Any]]:
    claims = json.loads((folder / "claims.json").read_text(encoding="utf-8"))
    assert isinstance(claims, list)
    for claim in claims:
        assert list(claim) == KEYS
        assert claim["verdict"] in VERDICTS
    return claims


def assert_page_shows_everything(folder: Path) -> None:
    page = (folder / "index.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    for claim in claims_in(folder):
        (row,) = [line for line in rows if line.startswith(f"| {claim['claim'].replace('|', chr(92) + '|')} |")]
        assert row.endswith(f"| **{claim['verdict']}** |")
        assert claim["assumption"].replace("|", "\\|") in row
        for value in (claim["paper_value"], claim["measured"]):
            words = "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"
            assert words.replace("|", "\\|") in row
        if claim["interval"] is not None:
            assert "[{:.4g}, {:.4g}]".format(*claim["interval"]) in row
    for path in folder.glob("*.json"):
        data = json.loads(path.read_text(encoding="utf-8"))
        if path.name == "claims.json":
            continue
        paper = PAPERS[data["paper"]]
        assert f"## {paper.name}\n\nPaper {paper.number}: {paper.citation}" in page
        counts = [sum(claim["verdict"] == word for claim in data["claims"]) for word in sorted(VERDICTS, key=len)]
        reproduced, conditional, not_so = counts
        expected = f"| [{paper.name}](#{paper.name}) | {paper.subject} | {reproduced} | {conditional} | {not_so} |"
        assert expected in rows
        for table in data["tables"]:
            assert f"### {table['title']}\n" in page
            for line in (table["headings"], *table["rows"]):
                assert "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" in rows
        for figure in data["figures"]:
            assert f"![{figure['caption']}]({figure['file']})" in page
            assert (folder / figure["file"]).stat().st_size > 1000


def test_a_real_paper(passloc: Passloc, tmp_path: Path) -> None:
    """The quickest one, in few runs."""
    status, out, err = passloc("reproduce", "cross-fix", "--runs", "20", "--seed", "3", "--out", "made")
    assert (status, err) == (0, "")
    claims = claims_in(tmp_path / "made")
    assert {claim["paper"] for claim in claims} == {"cross-fix"}
    assert f"{len(claims)} claims in" in out
    assert "1/1 cross-fix" in out
    assert "made/claims.json" in out
    assert "made/index.md" in out
    data = json.loads((tmp_path / "made" / "cross-fix.json").read_text(encoding="utf-8"))
    assert (data["runs"], data["seed"]) == (20, 3)
    assert data["claims"] == claims
    assert_page_shows_everything(tmp_path / "made")
    page = (tmp_path / "made" / "index.md").read_text(encoding="utf-8")
    assert "passloc reproduce cross-fix --out made --runs 20 --seed 3" in page


@pytest.mark.usefixtures("pretended")
def test_all_papers_in_the_order_of_their_numbers(passloc: Passloc, tmp_path: Path) -> None:
    status, out, _ = passloc("reproduce", "--out", "made")
    assert status == 0
    folder = tmp_path / "made"
    found = [claim["paper"] for claim in claims_in(folder)]
    assert list(dict.fromkeys(found)) == list(PAPERS)
    assert len(found) == 4 * len(PAPERS)
    assert [paper.number for paper in PAPERS.values()] == ["000", "001", "002", "003", "004"]
    assert_page_shows_everything(folder)
    assert all(f"{number}/5 {name}: {paper.subject}" in out for number, (name, paper) in enumerate(PAPERS.items(), 1))
    text = (folder / "index.md").read_text(encoding="utf-8")
    assert all(f"passloc reproduce {name} --out made\n" in text for name in PAPERS)


@pytest.mark.usefixtures("pretended")
def test_claims_are_plain_data(passloc: Passloc, tmp_path: Path) -> None:
    """Numbers with their intervals, words as they are, and null for what is no number, which JSON does not know."""
    passloc("reproduce", "dual-array", "--out", "made", "--runs", "7", "--seed", "2")
    words, number, estimate, never = claims_in(tmp_path / "made")
    mean = np.random.default_rng(2).normal(size=7).mean()
    assert words["measured"] == "it does"
    assert (number["paper_value"], number["measured"]) == (0.125, mean)
    np.testing.assert_allclose(number["interval"], [mean - 1.0, mean + 1.0])
    assert number["assumption"] == "7 runs"
    assert (estimate["measured"], estimate["interval"]) == (12345.678, [12000.0, 13000.0])
    assert (never["measured"], never["interval"]) == (None, None)


@pytest.mark.usefixtures("pretended")
def test_one_paper_again_leaves_the_others(passloc: Passloc, tmp_path: Path) -> None:
    folder = tmp_path / "made"
    passloc("reproduce", "cross-fix", "--out", "made", "--runs", "5")
    first = claims_in(folder)
    passloc("reproduce", "bearing-doppler", "--out", "made", "--runs", "5")
    both = claims_in(folder)
    assert both[4:] == first
    assert {claim["paper"] for claim in both[:4]} == {"bearing-doppler"}
    passloc("reproduce", "cross-fix", "--out", "made", "--runs", "6")
    again = claims_in(folder)
    assert again[:4] == both[:4]
    assert again[4:] != first
    assert len(again) == 8
    assert_page_shows_everything(folder)


@pytest.mark.usefixtures("pretended")
def test_the_page_tells_how_each_paper_was_made(passloc: Passloc, tmp_path: Path) -> None:
    """Numbers of an earlier command are still there, and so is that command."""
    passloc("reproduce", "cross-fix", "--out", "made", "--runs", "5")
    passloc("reproduce", "bearing-doppler", "--out", "made", "--runs", "9", "--seed", "4")
    page = (tmp_path / "made" / "index.md").read_text(encoding="utf-8")
    assert "passloc reproduce bearing-doppler --out made --runs 9 --seed 4" in page
    assert "passloc reproduce cross-fix --out made --runs 5" in page


@pytest.mark.parametrize(
    ("runs", "words"), [("49", "49 runs: fewer than the 50 that verdicts are meant for"), ("50", "")]
)
@pytest.mark.usefixtures("pretended")
def test_verdicts_of_few_runs_are_cautioned(passloc: Passloc, tmp_path: Path, runs: str, words: str) -> None:
    """On the terminal and on the page, also when the page is written again."""
    assert passloc("reproduce", "dual-array", "--out", "made", "--runs", "50")[0] == 0
    said = passloc("reproduce", "cross-fix", "--out", "made", "--runs", runs)[1]
    pages = [(tmp_path / "made" / "index.md").read_text(encoding="utf-8")]
    passloc("reproduce", "dual-array", "--out", "made")
    pages.append((tmp_path / "made" / "index.md").read_text(encoding="utf-8"))
    for text in (said, *pages):
        assert text.count("fewer than") == bool(words)
        assert words in text


@pytest.mark.usefixtures("pretended")
def test_same_seed_same_files(passloc: Passloc, tmp_path: Path) -> None:
    for folder, seed in (("one", "1"), ("again", "1"), ("two", "2")):
        assert passloc("reproduce", "dual-array", "--out", folder, "--runs", "4", "--seed", seed)[0] == 0
    assert claims_in(tmp_path / "one") == claims_in(tmp_path / "again") != claims_in(tmp_path / "two")
    one, again, two = ((tmp_path / folder / "dual-array_curve.png").read_bytes() for folder in ("one", "again", "two"))
    assert one == again != two


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("cros-fix",), "did you mean 'cross-fix'? known: 000, 001, 002, 003, 004, all, bearing-doppler"),
        (("Dual-Satelite",), "did you mean 'dual-satellite'?"),
        (("005",), "no such paper"),
        (("cross-fix", "--runs", "1"), "runs = 1 is not possible: must be at least 2"),
        (("cross-fix", "--runs", "0"), "at least 2"),
        (("all", "--runs", "-5"), "at least 2"),
        (("cross-fix", "--seed", "-1"), "seed = -1 is not possible: must be at least 0"),
        (("cross-fix", "--out", "file"), "file is not a folder"),
        (("cross-fix", "--out", "file/deeper"), "file"),
        pytest.param(
            ("cross-fix", "--out", "/proc/self"),
            "cannot be written into",
            marks=pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs an unwritable folder"),
        ),
    ],
)
@pytest.mark.usefixtures("no_papers")
def test_refusals_are_one_line(refused: Callable[..., str], tmp_path: Path, words: tuple[str, ...], hint: str) -> None:
    """And come before anything is run or written."""
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    assert hint in refused("reproduce", *words)
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]


@pytest.mark.parametrize("text", ['{"paper": "cross-fix", "cla', "[]", '{"paper": "cross-fix"}'])
@pytest.mark.usefixtures("no_papers")
def test_a_broken_file_of_another_paper_is_said_first(refused: Callable[..., str], tmp_path: Path, text: str) -> None:
    """As an interrupted run may leave it behind."""
    (tmp_path / "cross-fix.json").write_text(text, encoding="utf-8")
    assert "cross-fix.json" in refused("reproduce", "dual-array", "--out", ".", "--runs", "4")


@pytest.mark.usefixtures("pretended")
def test_a_broken_file_is_replaced(passloc: Passloc, tmp_path: Path) -> None:
    """Those of all papers that are made again."""
    (tmp_path / "cross-fix.json").write_text('{"paper": "cross-fix", "cla', encoding="utf-8")
    assert passloc("reproduce", "dual-array", "--out", ".", "--runs", "4")[0] == 2
    assert passloc("reproduce", "cross-fix", "--out", ".", "--runs", "4")[0] == 0
    assert len(claims_in(tmp_path)) == 4


@pytest.mark.parametrize("interval", [(0.5, math.inf), (math.nan, math.nan)])
def test_intervals_without_an_end_are_written(
    passloc: Passloc, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interval: tuple[float, float]
) -> None:
    """As runs that diverge leave them: null for what is no number, and a page that does not say nan."""

    def diverge(reproduction: Reproduction) -> None:
        reproduction.claim("diverges", 1.0, math.inf, Verdict.NOT_REPRODUCIBLE, interval=interval)

    monkeypatch.setattr("training.papers.cross_fix.reproduce", diverge)
    status, _, err = passloc("reproduce", "cross-fix", "--out", "made")
    assert (status, err) == (0, "")
    (claim,) = claims_in(tmp_path / "made")
    assert claim["measured"] is None
    page = (tmp_path / "made" / "index.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith("| diverges |")]
    assert "nan" not in row.lower()
    assert "none" not in row.lower()


def test_papers_by_name() -> None:
    assert [paper.name for paper in find_papers("all")] == list(PAPERS)
    for name, paper in PAPERS.items():
        assert find_papers(name) == find_papers(paper.number) == [paper]
        assert callable(importlib.import_module(f"training.papers.{name.replace('-', '_')}").reproduce)
    with pytest.raises(InputError, match="did you mean 'dual-array'"):
        find_papers("dual-aray")


def test_a_reproduction_keeps_what_it_is_given(tmp_path: Path) -> None:
    reproduction = Reproduction("cross-fix", tmp_path, runs=7)
    assert (reproduction.runs_or(100), Reproduction("cross-fix", tmp_path).runs_or(100)) == (7, 100)
    assert (holds(True), holds(False)) == (Verdict.REPRODUCED, Verdict.NOT_REPRODUCIBLE)
    with reproduction.figure("grid", "four", rows=2, columns=2, size=(2.0, 1.5)) as axes:
        assert axes.shape == (2, 2)
        np.testing.assert_allclose(axes[0, 0].figure.get_size_inches(), [4.0, 3.0])
    with pytest.raises(KeyError), reproduction.figure("broken", "none"):
        raise KeyError
    assert [figure.file for figure in reproduction.figures] == ["cross-fix_grid.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["cross-fix_grid.png"]
