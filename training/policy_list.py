"""All policies at a glance, for the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.padding import Padding

from agents.parameters import Parameter
from training.arguments import writable_folder
from training.commands import List
from training.policy_words import Described, described_agents, described_planners, described_rules
from training.progress import console

_BELOW, _FURTHER_BELOW = (0, 0, 0, 4), (0, 0, 0, 8)


def list_policies(arguments: List) -> dict[str, Any]:
    """Print the policies, and write their page where that is asked for; what was printed, as plain data."""
    if arguments.pages is not None:
        from training.policy_pages import write_page

        write_page(writable_folder(arguments.pages))
    policies = [*described_rules(), *described_planners(), *described_agents()]
    print_policies(policies, console)
    return {
        policy.name: {
            "does": policy.does,
            "scenarios": list(policy.scenarios),
            "knows_truth": policy.knows_truth,
            "parameters": {
                name: {
                    "meaning": told.kind.meaning,
                    "unit": told.kind.unit,
                    "default": told.default,
                    "by_default": told.shown,
                    "allowed": told.kind.allowed,
                }
                for name, told in policy.parameters.items()
            },
        }
        for policy in policies
    }


def print_policies(policies: list[Described], console: Console) -> None:
    """What each does and flies, and a line per parameter: default, meaning, unit, what is allowed."""
    for policy in policies:
        console.print(policy.name, highlight=False, soft_wrap=True)
        told = " Told the truth." if policy.knows_truth else ""
        console.print(Padding(f"{policy.does}{told} Scenarios: {policy.flies}.", _BELOW), highlight=False)
        if policy.like:
            console.print(Padding(f"parameters: those of {policy.like}", _FURTHER_BELOW), highlight=False)
        else:
            for name, parameter in policy.parameters.items():
                console.print(Padding(_line(name, parameter), _FURTHER_BELOW), highlight=False)


def _line(name: str, parameter: Parameter) -> str:
    """A parameter as it is written by default, what it means, its unit, and what is allowed."""
    kind = parameter.kind
    written = f"{name}, by default {parameter.shown}" if kind.by_default else f"{name}={parameter.shown}"
    unit = f", {kind.unit}" if kind.unit else ""
    return f"{written}: {kind.meaning}{unit}; {kind.allowed}"
