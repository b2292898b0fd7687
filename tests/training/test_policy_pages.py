"""The page of all policies: complete, and committed as the code writes it now."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from agents import PLANNER_NAMES, RULE_NAMES, TruthKnowing, find_policy, rules_for, shipped_agents
from agents.catalogue import parameters_of
from passloc_env.scenarios import SCENARIOS
from training.cli import main
from training.policy_list import print_policies
from training.policy_pages import PAGE, page
from training.policy_words import RUN, described_agents, described_planners, described_rules

COMMITTED = Path(__file__).parents[2] / "docs" / PAGE
NAMES = [*RULE_NAMES, *PLANNER_NAMES, "learned", *(f"agent:{name}" for name in shipped_agents()), RUN]
EVERYBODY = [*described_rules(), *described_planners(), *described_agents()]


def test_the_committed_page_is_what_the_code_writes() -> None:
    stale = f"{PAGE} is stale: run `passloc list --policies --pages docs`"
    assert COMMITTED.read_text(encoding="utf-8") == page(), stale


def test_everybody_is_there_once() -> None:
    assert [policy.name for policy in EVERYBODY] == NAMES
    rows = [line.strip("| ").split(" | ") for line in page().splitlines() if line.startswith("| `")]
    assert [row[0].strip("`") for row in rows if len(row) == 3] == NAMES


def test_every_parameter_is_there() -> None:
    """In the section of its policy, or in that of the namesake which takes just the same."""
    sections = {part.partition("\n")[0]: part for part in page().split("\n### ")[1:]}
    for policy in EVERYBODY:
        assert (policy.name in sections) == (bool(policy.parameters) and not policy.like)
        if policy.like:
            assert policy.name == f"{policy.like}-truth"
            assert parameters_of(policy.name) == parameters_of(policy.like)
        for name, told in policy.parameters.items():
            cells = (f"`{name}`", told.kind.meaning, told.kind.unit, told.shown, told.kind.allowed)
            assert f"| {' | '.join(cells)} |" in sections[policy.like or policy.name]


def test_written_at_length_it_is_the_same_policy() -> None:
    scenario = SCENARIOS["BearingsOnly"]
    at_length = [policy for policy in EVERYBODY if policy.parameters]
    assert len(at_length) == 1 + len(PLANNER_NAMES)
    for policy in at_length:
        assert policy.written_out.count(":") >= 2
        assert find_policy(policy.written_out, scenario) == find_policy(policy.name, scenario)
        assert policy.knows_truth == isinstance(find_policy(policy.name, scenario), TruthKnowing)


def test_scenarios_are_those_that_can_be_flown() -> None:
    for policy in described_rules():
        assert policy.scenarios == tuple(name for name in SCENARIOS if policy.name in rules_for(SCENARIOS[name]))
    flies = {policy.name: policy.flies for policy in EVERYBODY}
    assert flies["random"] == "all"
    assert flies["circle"] == "all but DualSatellite"
    assert flies["legs"] == "OwnShipModerate, OwnShipSevere"
    assert flies["agent:BearingDopplerIMM"] == "BearingDoppler"


def test_the_command_writes_the_page_and_says_the_same(tmp_path: Path) -> None:
    answer = tmp_path / "answer.json"
    assert main(["list", "--policies", "--pages", str(tmp_path / "new"), "--json", str(answer), "-q"]) == 0
    assert (tmp_path / "new" / PAGE).read_text(encoding="utf-8") == page()
    data = json.loads(answer.read_text(encoding="utf-8"))
    assert list(data) == NAMES
    assert data["zigzag"]["parameters"]["angle"]["default"] == find_policy("zigzag", SCENARIOS["BearingsOnly"]).angle
    assert data["horizon"]["parameters"]["seconds"]["default"] is None
    assert data["horizon-truth"]["knows_truth"] is True


@pytest.mark.parametrize("width", [60, 120])
def test_the_terminal_shows_everything_in_its_width(width: int) -> None:
    output = io.StringIO()
    print_policies(EVERYBODY, Console(width=width, file=output))
    lines = output.getvalue().splitlines()
    assert all(len(line.rstrip()) <= width for line in lines)
    assert [line for line in lines if not line.startswith(" ")] == NAMES
    text = " ".join(output.getvalue().split())
    for policy in EVERYBODY:
        assert policy.does in text
        for name, told in policy.parameters.items():
            assert f"{name}={told.shown}: " in text or f"{name}, by default {told.shown}: " in text
            assert f"; {told.kind.allowed}" in text
