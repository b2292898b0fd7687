"""Evaluating while somebody watches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from agents import Policy, default_policies, find_policy
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import parse_overrides
from training.commands import EVALUATION_SEED, Evaluate
from training.engines import ALONE, Engine, opened
from training.evaluate import Evaluation, evaluate
from training.progress import console, progress_bar
from training.table import rich_table


def judge_policies(arguments: Evaluate) -> Evaluation:
    """Judge policies as the arguments say, and print the table.

    Raises:
        InputError: an unknown scenario or policy, or impossible numbers.
    """
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    names = arguments.policies.split(",") if arguments.policies else default_policies(scenario)
    asked = tuple(name.strip() for name in names)
    policies = [find_policy(name, scenario) for name in asked]
    with opened(arguments.work) as engine:
        evaluation = judge(scenario, policies, arguments.episodes, arguments.seed, engine, arguments.results)
    evaluation.asked = asked
    console.print(rich_table(evaluation, console.width))
    return evaluation


def judge(
    scenario: Scenario,
    policies: Sequence[Policy],
    episodes: int,
    seed: int = EVALUATION_SEED,
    engine: Engine = ALONE,
    folder: Path | None = None,
) -> Evaluation:
    """Evaluate with a progress bar; arguments and errors are those of :func:`training.evaluate.evaluate`."""
    with progress_bar("episodes") as bar:
        task = bar.add_task("judging", total=episodes * len(policies))

        def advance(policy: str, done: int) -> None:
            bar.update(task, advance=done, description=f"judging {policy}")

        return evaluate(scenario, policies, episodes, seed, advance, engine, folder)
