"""One agent trained from several seeds: how far chance decides what it learns."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents import find_policy
from agents.agent_file import AgentFile
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import at_least_one, check_seed
from training.candidate import Candidate, train_missing
from training.card import reference_of
from training.commands import Seeds
from training.curve import read_curve
from training.engines import opened
from training.evaluate import Evaluation
from training.files import write_whole
from training.hyperparameters import Hyperparameters
from training.judging import judge
from training.progress import console
from training.score import score_of
from training.seed_pictures import draw_curves
from training.table import markdown_table, notes, title
from training.train import check_training


def seeds(arguments: Seeds) -> Path:
    """Train an agent per seed unless it is there, and judge them all beside a rule; the page about them.

    Raises:
        ScenarioError: an unknown scenario.
        HyperparameterError: an impossible number of decisions.
        InputError: no seeds, negative or repeated ones, fewer than one episode, or a folder with agents of other
            settings.
        FileExistsError: the folder is a file.
    """
    scenario = find(arguments.scenario)
    at_least_one(episodes=arguments.episodes)
    candidates = _candidates(scenario, arguments)
    rule = find_policy(reference_of(scenario), scenario)
    with opened(arguments.work) as engine:
        train_missing(candidates, arguments.out, engine)
        policies = [rule, *(candidate.policy for candidate in candidates)]
        evaluation = judge(scenario, policies, arguments.episodes, engine=engine)
    stem = arguments.out / scenario.name
    evaluation.save(stem.with_suffix(".json"))
    curves = {candidate.name: read_curve(candidate.folder / "curve.csv") for candidate in candidates}
    draw_curves(curves, f"{scenario.name}: learning from {len(curves)} seeds", stem.with_suffix(".png"))
    page = stem.with_suffix(".md")
    write_whole(page, _page(evaluation, candidates, arguments))
    console.print(f"{page}", highlight=False, soft_wrap=True)
    return page


def _candidates(scenario: Scenario, arguments: Seeds) -> list[Candidate]:
    """A candidate per seed."""
    if not arguments.seeds or len(set(arguments.seeds)) < len(arguments.seeds):
        raise InputError(f"seeds = {arguments.seeds} is not possible: must be one or more, each of them once")
    for seed in arguments.seeds:
        check_seed(seed)
    parameters = Hyperparameters.for_scenario(scenario.name)
    if arguments.decisions is not None:
        parameters = dataclasses.replace(parameters, decisions=arguments.decisions)
    check_training(scenario, parameters)
    return [
        Candidate(f"seed {seed}", scenario, parameters, seed, arguments.out / f"{scenario.name}-{seed}")
        for seed in arguments.seeds
    ]


def _page(evaluation: Evaluation, candidates: Sequence[Candidate], arguments: Seeds) -> str:
    rule, *agents = evaluation.verdicts
    score = score_of(evaluation.scenario)
    values = np.array([score.cell(agent).value for agent in agents])
    gain = score.cell(rule).value - values.mean()
    cards = [AgentFile.load(candidate.folder).card["training"] for candidate in candidates]
    minutes = ", ".join(f"{card['seconds'] / 60:.1f}" for card in cards)
    machine = cards[0]["machine"]
    return "\n".join(
        [
            f"# {evaluation.scenario.name}: {len(agents)} training seeds\n",
            f"The same agent, PPO for {candidates[0].parameters.decisions:,} decisions, from seeds that differ; "
            f"trained in {minutes} minutes on one core ({machine['processor']}). From the best seed to the worst the "
            f"{score.column} differs by {np.ptp(values):.3f}: {100 * np.ptp(values) / gain:.0f} % of what the agents "
            f"gain on *{rule.policy}* on average. Written by",
            f"\n```sh\n{_command(arguments)}\n```\n",
            f"![Return and violations in training, against decisions and wall time]({evaluation.scenario.name}.png)\n",
            f"{title(evaluation)}\n",
            markdown_table(evaluation),
            f"*{notes(evaluation)}*\n",
        ]
    )


def _command(arguments: Seeds) -> str:
    words = ["passloc", "seeds", arguments.scenario, "--seeds", *map(str, arguments.seeds)]
    if arguments.decisions is not None:
        words += ["--decisions", str(arguments.decisions)]
    return shlex.join([*words, "--episodes", str(arguments.episodes), "--out", arguments.out.as_posix()])
