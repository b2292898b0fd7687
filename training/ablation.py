"""Which reward leads where: the same learner with one reward after another, judged by what tracking is about."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path

from passloc_env.rewards import (
    DEFAULT_REWARD,
    FilterCertainty,
    GramGain,
    KeepOut,
    RangeBound,
    RewardTerm,
    TrackingError,
)
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import at_least_one, check_seed
from training.candidate import Candidate, train_missing
from training.commands import Ablate
from training.evaluate import Evaluation
from training.files import write_whole
from training.hyperparameters import Hyperparameters
from training.judging import judge
from training.progress import console
from training.table import markdown_table, notes, title
from training.train import check_training

_BARE: dict[str, tuple[RewardTerm, ...]] = {
    "range bound": (RangeBound(),),
    "Gram gain": (GramGain(weight=1.0),),
    "filter certainty": (FilterCertainty(),),
    "tracking error": (TrackingError(weight=10.0),),
    "range bound + Gram gain": (RangeBound(), GramGain()),
    "range bound + Gram gain + tracking error": (RangeBound(), GramGain(), TrackingError()),
}

REWARDS: dict[str, tuple[RewardTerm, ...]] = {
    name + kept: (*terms, *keeping)
    for name, terms in _BARE.items()
    for kept, keeping in (("", ()), (" + keep-out", (KeepOut(),)))
}
"""The rewards that are compared, by name; the default is among them."""

_DEFAULT = next(name for name, terms in REWARDS.items() if terms == DEFAULT_REWARD)


def ablate(arguments: Ablate) -> Path:
    """Train an agent per reward unless it is there, and judge them all; the page that compares them.

    Raises:
        ScenarioError: an unknown scenario.
        InputError: fewer than one decision or episode, a negative seed, or a folder with agents of other settings.
        FileExistsError: the folder is a file.
    """
    scenario = find(arguments.scenario)
    check_seed(arguments.seed)
    at_least_one(decisions=arguments.decisions, episodes=arguments.episodes)
    candidates = _candidates(scenario, arguments)
    folder = arguments.out
    train_missing(candidates, folder)
    evaluation = judge(scenario, [candidate.policy for candidate in candidates], arguments.episodes)
    evaluation.save(folder / "rewards.json")
    page = folder / "rewards.md"
    write_whole(page, _page(evaluation, arguments))
    console.print(f"{page}", highlight=False, soft_wrap=True)
    return page


def _candidates(scenario: Scenario, arguments: Ablate) -> list[Candidate]:
    """A candidate per reward; nothing guards them, for what the reward does by itself is looked at."""
    shipped = Hyperparameters.for_scenario(scenario.name)
    parameters = dataclasses.replace(
        shipped,
        decisions=arguments.decisions,
        shield_sigmas=0.0,
        shielded_training=False,
        violation_price=0.0,
        # Where training is shipped with a reward of its own, that gives way to the one that is tried.
        overrides={name: value for name, value in shipped.overrides.items() if name.partition(".")[0] != "reward"},
    )
    candidates = [
        Candidate(
            name,
            scenario.replace(reward=terms),
            parameters,
            arguments.seed,
            arguments.out / name.replace("+", "and").replace(" ", "-"),
        )
        for name, terms in REWARDS.items()
    ]
    for candidate in candidates:
        check_training(candidate.scenario, parameters)
    return candidates


def _page(evaluation: Evaluation, arguments: Ablate) -> str:
    options = {
        "--decisions": arguments.decisions,
        "--episodes": arguments.episodes,
        "--seed": arguments.seed,
        "--out": arguments.out.as_posix(),
    }
    words = [str(word) for option in options.items() for word in option]
    command = shlex.join(["passloc", "ablate", evaluation.scenario.name, *words])
    return "\n".join(
        [
            "# Which reward leads where\n",
            f"One learner, PPO for {arguments.decisions:,} decisions each on {evaluation.scenario.name}, with one "
            "reward after another; *keep-out* adds the bounded penalty near the minimum range. In training an episode "
            "ends when that range is entered: a reward that is positive pays for staying out, one that is negative "
            f"pays for an early end. No shield. The default is *{_DEFAULT}*. Written by",
            f"\n```sh\n{command}\n```\n",
            f"{title(evaluation)}\n",
            markdown_table(evaluation),
            f"*{notes(evaluation)}*\n",
        ]
    )
