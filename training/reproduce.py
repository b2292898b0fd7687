"""The command that reproduces papers."""

from __future__ import annotations

import time

from rich.text import Text

from passloc_env.errors import InputError
from training.arguments import check_seed, writable_folder
from training.commands import Reproduce
from training.engines import opened
from training.papers.catalogue import find_papers
from training.papers.page import check_others, collect, save
from training.papers.reproduction import Reproduction
from training.progress import console

_COLOURS = {"reproduced": "green", "reproduced-if": "yellow", "not-reproducible": "red"}


def reproduce(arguments: Reproduce) -> list[Reproduction]:
    """Run the papers asked for, one after the other; each is saved as soon as it is done."""
    papers = find_papers(arguments.paper)
    if arguments.runs is not None and arguments.runs < 2:
        raise InputError(f"runs = {arguments.runs} is not possible: must be at least 2")
    check_seed(arguments.seed)
    check_others(arguments.out, papers)
    writable_folder(arguments.out)
    finished = []
    with opened(arguments.work) as engine:
        for number, paper in enumerate(papers, 1):
            console.print(f"{number}/{len(papers)} {paper.name}: {paper.subject}", highlight=False)
            begun = time.perf_counter()
            reproduction = Reproduction(paper.name, arguments.out, arguments.runs, arguments.seed, engine)
            paper.reproduce(reproduction)
            save(reproduction, arguments.out, _command(arguments, paper.name))
            _print(reproduction, time.perf_counter() - begun)
            finished.append(reproduction)
    for path in collect(arguments.out):
        console.print(f"{path}", highlight=False, soft_wrap=True)
    return finished


def _print(reproduction: Reproduction, seconds: float) -> None:
    for claim in reproduction.claims:
        measured = claim.measured if isinstance(claim.measured, str) else f"{claim.measured:.4g}"
        verdict = (f"{claim.verdict:16s}", _COLOURS[claim.verdict])
        console.print(Text.assemble("    ", verdict, f" {claim.claim}: {measured}"))
    console.print(f"    {len(reproduction.claims)} claims in {seconds:.0f} s", highlight=False)
    if reproduction.caution:
        console.print(f"    {reproduction.caution}", highlight=False)


def _command(arguments: Reproduce, paper: str) -> str:
    """What to type to make one paper's part again."""
    words = ["passloc reproduce", paper, "--out", arguments.out.as_posix()]
    if arguments.runs is not None:
        words += ["--runs", str(arguments.runs)]
    if arguments.seed:
        words += ["--seed", str(arguments.seed)]
    return " ".join(words)
