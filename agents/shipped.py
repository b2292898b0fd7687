"""The agents that come with passloc: which there are, and which scenario each was made for."""

from __future__ import annotations

import shlex
from pathlib import Path

from agents.agent_file import CARD, AgentFile, AgentFileError
from agents.learned import LearnedPolicy
from passloc_env.errors import unknown_name
from passloc_env.scenario import Scenario

FOLDER = Path(__file__).parent / "pretrained"
"""One folder per agent, which bears its name; each card says under ``flies`` which scenarios it is for."""


def shipped_agents() -> tuple[str, ...]:
    """The names of all shipped agents, sorted."""
    return tuple(sorted(card.parent.name for card in FOLDER.glob(f"*/{CARD}")))


def load(name: str, scenario: Scenario | None = None) -> LearnedPolicy:
    """A shipped agent, ready to fly.

    Args:
        name: one of :func:`shipped_agents`.
        scenario: the problem to fly; None: any.

    Raises:
        AgentFileError: no such agent (with the closest name), or one that does not fit the scenario.
    """
    policy = LearnedPolicy.load(agent_folder(name), scenario)
    policy.name = f"learned {name}"
    return policy


def agent_folder(name: str) -> Path:
    """Where a shipped agent lies.

    Raises:
        AgentFileError: no such agent, with the closest name.
    """
    names = shipped_agents()
    if not names:
        raise AgentFileError(f"agent = {name!r} is not possible: no agents are shipped")
    if name not in names:
        raise AgentFileError(str(unknown_name("agent", name, names, "shipped agent")))
    return FOLDER / name


def agents_for(scenario: str) -> tuple[str, ...]:
    """The shipped agents that fly a scenario, by its name; the one that bears the scenario's name comes first."""
    made_for = [name for name in shipped_agents() if scenario in AgentFile.load(FOLDER / name).flies]
    return tuple(sorted(made_for, key=lambda name: name != scenario))


def learned(scenario: Scenario) -> LearnedPolicy:
    """The shipped agent made for a scenario, the first that fits where there are several.

    Raises:
        AgentFileError: no shipped agent is for it, or it was changed so that none of its agents fits.
    """
    names = agents_for(scenario.name)
    if not names:
        taken = [name for agent in shipped_agents() for name in AgentFile.load(FOLDER / agent).flies]
        known = ", ".join(sorted(set(taken))) or "none"
        raise AgentFileError(
            f"policy = 'learned' is not possible: no shipped agent flies {scenario.name}; scenarios with one: {known}"
        )
    faults: list[AgentFileError] = []
    for name in names:
        try:
            return load(name, scenario)
        except AgentFileError as fault:
            faults.append(fault)
    raise faults[0]


def ship(agent: AgentFile, name: str) -> Path:
    """Put an agent among the shipped ones, in the place of one of the same name; its folder.

    Where its run lay is nobody's business: the card's command loses its ``--out``.
    """
    training = agent.card.get("training", {})
    if "command" in training:
        training["command"] = _without_out(training["command"])
    folder = FOLDER / name
    folder.mkdir(parents=True, exist_ok=True)
    agent.save(folder)
    return folder


def _without_out(command: str) -> str:
    """A command without the option that names the folder of a run."""
    words = iter(shlex.split(command))
    kept = []
    for word in words:
        if word == "--out":
            next(words, None)
        elif not word.startswith("--out="):
            kept.append(word)
    return shlex.join(kept)
