"""The page of all policies, written from the policies themselves: no default and no limit on it is typed twice."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path

from agents import WithTruth
from training.files import write_whole
from training.markdown import markdown
from training.policy_words import Described, described_agents, described_planners, described_rules

PAGE = "policies.md"

_HEAD = """# Policies

Who can fly, as every command takes it: by name, with parameters after colons, in any order, and several policies
separated by commas.

```sh
passloc evaluate BearingsOnly --policies circle,zigzag:angle=45:leg=80,learned --episodes 64
passloc replay BearingsOnly --policy horizon:seconds=48 --gif runs/horizon.gif
```

In Python, `agents.find_policy("zigzag:angle=45:leg=80", scenario)`. A wrong name or value is one line that says what
would have been right. `passloc list --policies` has all of this in the terminal;
[a policy of your own](guides/own_policy.md) is a class with one method."""

_AGENTS = """Trained networks. `passloc train` makes them; a shipped one flies wherever the observation and the actions
are those that it was trained with, and is made for the scenarios named here."""


def write_page(folder: Path) -> Path:
    """Write the page into a folder; its path."""
    path = folder / PAGE
    write_whole(path, page())
    return path


def page() -> str:
    """Every policy: what it does, what it can fly, and all that it can be told."""
    planners = described_planners()
    blind = [planner for planner in planners if not planner.knows_truth]
    knowing = [planner for planner in planners if planner.knows_truth]
    parts = [
        _HEAD,
        *_section("Rules", "Fixed recipes, from the believed line of sight and the clock.", described_rules()),
        *_section("Planners", "They look ahead from the belief, and from nothing else.", blind),
        *_section(
            "Planners that are told the truth",
            f"{inspect.getdoc(WithTruth)} Each can be told what its namesake can.",
            knowing,
        ),
        *_section("Agents", _AGENTS, described_agents()),
    ]
    return "\n\n".join(parts) + "\n"


def _section(heading: str, words: str, policies: list[Described]) -> Iterator[str]:
    yield f"## {heading}"
    yield words
    yield markdown(
        ("policy", "what it does", "scenarios"), [(f"`{each.name}`", each.does, each.flies) for each in policies]
    )
    for policy in policies:
        if policy.parameters and not policy.like:
            yield from _parameters(policy)


def _parameters(policy: Described) -> Iterator[str]:
    yield f"### {policy.name}"
    rows = [
        (f"`{name}`", told.kind.meaning, told.kind.unit, told.shown, told.kind.allowed)
        for name, told in policy.parameters.items()
    ]
    yield markdown(("parameter", "meaning", "unit", "default", "allowed"), rows)
    yield f"By default, written at length: `{policy.written_out}`."
