"""Which reward leads where: the same learner with one reward after another, judged by what tracking is about."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from agents import LearnedPolicy
from agents.agent_file import AgentFile
from passloc_env.errors import InputError
from passloc_env.rewards import FilterCertainty, GramGain, KeepOut, RangeBound, RewardTerm, TrackingError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import check_seed
from training.commands import EVALUATION_SEED, Ablate
from training.evaluate import Evaluation, evaluate
from training.hyperparameters import Hyperparameters
from training.progress import console
from training.table import markdown_table, notes, title
from training.train import run

REWARDS: dict[str, tuple[RewardTerm, ...]] = {
    "range bound": (RangeBound(),),
    "Gram gain": (GramGain(weight=1.0),),
    "filter certainty": (FilterCertainty(),),
    "tracking error": (TrackingError(weight=10.0),),
    "range bound + Gram gain": (RangeBound(), GramGain()),
    "default": (RangeBound(), GramGain(), TrackingError()),
}
"""Rewards by name, each tried with and without a keep-out."""


def ablate(arguments: Ablate) -> Path:
    """Train and judge an agent per reward; the page that compares them.

    Raises:
        InputError: fewer than one decision or episode, or a negative seed.
    """
    scenario = find(arguments.scenario)
    check_seed(arguments.seed)
    for name in ("decisions", "episodes"):
        if getattr(arguments, name) < 1:
            raise InputError(f"{name} = {getattr(arguments, name)} is not possible: must be at least 1")
    policies = []
    for name, terms in REWARDS.items():
        for kept, rewards in (("", terms), (" + keep-out", (*terms, KeepOut()))):
            console.print(f"reward: {name}{kept}", highlight=False)
            policies.append(_trained(scenario, name + kept, rewards, arguments))
    evaluation = evaluate(scenario, policies, arguments.episodes, EVALUATION_SEED)
    page = arguments.out / "rewards.md"
    page.write_text(_page(evaluation, arguments), encoding="utf-8")
    evaluation.save(arguments.out / "rewards.json")
    console.print(f"{page}", highlight=False, soft_wrap=True)
    return page


def _trained(scenario: Scenario, name: str, rewards: tuple[RewardTerm, ...], arguments: Ablate) -> LearnedPolicy:
    """The agent of one reward, trained now or earlier; nothing guards it, for that is what is looked at."""
    folder = arguments.out / name.replace(" ", "-").replace("+", "and")
    wanted: dict[str, Any] = {"decisions": arguments.decisions, "shield_sigmas": 0.0}
    parameters = dataclasses.replace(Hyperparameters.for_scenario(scenario.name), **wanted)
    if not (folder / "agent.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        run(scenario.replace(reward=rewards), parameters, folder, arguments.seed)
    return LearnedPolicy(AgentFile.load(folder), name)


def _page(evaluation: Evaluation, arguments: Ablate) -> str:
    return "\n".join(
        [
            "# Which reward leads where\n",
            f"One learner, PPO for {arguments.decisions:,} decisions each on {evaluation.scenario.name}, with one "
            "reward after another; *keep-out* adds the bounded penalty near the minimum range. In training an episode "
            "ends when that range is entered: a reward that is positive pays for staying out, one that is negative "
            "pays for an early end. No shield. Written by",
            f"\n```sh\npassloc ablate {evaluation.scenario.name} --decisions {arguments.decisions} "
            f"--episodes {arguments.episodes} --out {arguments.out.as_posix()}\n```\n",
            f"{title(evaluation)}\n",
            markdown_table(evaluation),
            f"*{notes(evaluation)}*\n",
        ]
    )
