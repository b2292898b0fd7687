"""Searching hyperparameters: trial after trial is trained and judged, and the best found so far is written down."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import optuna
import yaml
from optuna.trial import TrialState

from agents import LearnedPolicy
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import at_least_one, check_seed, kept_folder, parse_overrides
from training.commands import Tune
from training.engines import opened
from training.episodes import fly
from training.files import unsaid, write_whole
from training.hyperparameters import Hyperparameters
from training.lock import held
from training.progress import console, progress_bar
from training.score import score_of
from training.search_space import suggest, unchanged
from training.study import ask, best_trial, completed, opened_study, rehearsed
from training.train import check_training, run

TUNING_SEED = 3_000_000
"""First seed of the episodes that trials are judged by: neither training seeds nor those of evaluations."""

_VIOLATION_COST = 5.0
"""What one violation per episode would cost, as a logarithm of the score: one in a hundred counts .05, or 5 %."""


def tune(arguments: Tune) -> Path:
    """Run more trials of a search, begun now or earlier; the first one tries the shipped hyperparameters.

    Returns:
        Where the best hyperparameters are, if any trial has been through.

    Raises:
        ScenarioError: an unknown scenario or field, or an impossible value.
        InputError: a number of trials, episodes or decisions below one, a negative seed, or a folder that holds
            another search, or in which one is under way.
        FileExistsError: the folder is a file.
    """
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    check_seed(arguments.seed)
    at_least_one(trials=arguments.trials, decisions=arguments.decisions, episodes=arguments.episodes)
    base = dataclasses.replace(Hyperparameters.for_scenario(scenario.name), decisions=arguments.decisions)
    check_training(scenario, base)
    folder = kept_folder(arguments.out or Path("runs") / "tune" / scenario.name)
    best = folder / "best.yaml"
    settings = _settings(scenario, base, arguments)
    with (
        held(folder),
        opened_study(folder / "study.db", settings) as study,
        opened(arguments.work) as engine,
        progress_bar("trials") as bar,
    ):
        task = bar.add_task(f"searching on {scenario.name}", total=arguments.trials)
        for begun in range(0, arguments.trials, engine.workers):
            trials, calls = list[optuna.Trial](), []
            for beside in range(min(engine.workers, arguments.trials - begun)):
                trials.append(ask(study, arguments.seed, unchanged(base), beside))
                calls.append((scenario, suggest(trials[-1], base), arguments, completed(study)))
            tried: dict[int, Tried] = {}
            for index, came_of_it in engine.map(_try, calls):
                tried[index] = came_of_it
                bar.advance(task)
            # Told together: a search that is interrupted before takes up the same trials again.
            for index, trial in enumerate(trials):
                said = _tell(study, trial, tried[index])
                console.print(f"trial {trial.number}: {said}", highlight=False, soft_wrap=True)
            _write_best(study, base, scenario, best)
        found = best_trial(study)
    if found is None:
        console.print("no trial has been through yet", highlight=False)
    else:
        said = f"best so far is trial {found.number} with {found.value:.3f}; its hyperparameters are in {best}"
        console.print(said, highlight=False, soft_wrap=True)
    return best


def _settings(scenario: Scenario, base: Hyperparameters, arguments: Tune) -> dict[str, Any]:
    """All that a trial's cost depends on beside what is suggested, as JSON gives it back."""
    parameters = dataclasses.asdict(base)
    settings = {
        "decisions": parameters.pop("decisions"),
        "episodes": arguments.episodes,
        "seed": arguments.seed,
        "scenario": scenario.to_dict(),
        "hyperparameters": parameters,
    }
    restored: dict[str, Any] = json.loads(json.dumps(settings))
    return restored


class Tried(NamedTuple):
    """What came of a trial.

    Attributes:
        cost: lower is better; None for one that was given up.
        reason: why it was.
        on_the_way: costs by the decisions after which they were seen.
    """

    cost: float | None
    reason: str
    on_the_way: dict[int, float]


def _try(
    scenario: Scenario, parameters: Hyperparameters, arguments: Tune, earlier: Sequence[optuna.trial.FrozenTrial]
) -> Tried:
    """Bring one trial to its end, beside those that have been through."""
    trial, on_the_way = rehearsed(earlier, parameters.decisions), dict[int, float]()

    def watch(row: dict[str, float]) -> None:
        # The search minimises, so pruners take what is reported for a cost.
        decisions = int(row["decisions"])
        on_the_way[decisions] = -row["mean_return"]
        trial.report(on_the_way[decisions], decisions)
        if trial.should_prune():
            raise optuna.TrialPruned(f"in the worst quarter after {decisions:,} decisions")

    try:
        return Tried(_cost(scenario, parameters, arguments, watch), "", on_the_way)
    except (optuna.TrialPruned, ValueError) as error:
        # A diverging learner ends as a ValueError of its normal distribution; to the sampler it counts as the worst.
        return Tried(None, str(error).partition("\n")[0], on_the_way)


def _tell(study: optuna.Study, trial: optuna.Trial, tried: Tried) -> str:
    """Write down what came of a trial; the same in words."""
    for decisions, cost in tried.on_the_way.items():
        trial.report(cost, decisions)
    if tried.cost is None:
        study.tell(trial, state=TrialState.PRUNED)
        return f"given up: {tried.reason}"
    study.tell(trial, tried.cost)
    return f"{tried.cost:.3f}"


def _cost(
    scenario: Scenario, parameters: Hyperparameters, arguments: Tune, watch: Callable[[dict[str, float]], None]
) -> float:
    """What the scenario's score says of an agent trained so, and what its violations cost; lower is better."""
    with tempfile.TemporaryDirectory() as folder, unsaid(Path(folder)):
        finished = run(scenario, parameters, Path(folder), arguments.seed, quiet=True, watch=watch)
    scores, _ = fly(scenario, LearnedPolicy(finished.agent), arguments.episodes, TUNING_SEED)
    return score_of(scenario).cost(scores) + float(_VIOLATION_COST * scores.violated.mean())


def _write_best(study: optuna.Study, base: Hyperparameters, scenario: Scenario, path: Path) -> None:
    """Write the hyperparameters of the best trial as a YAML file that ``passloc train --hyperparameters`` takes."""
    found = best_trial(study)
    if found is None:
        return
    data = dataclasses.asdict(suggest(optuna.trial.FixedTrial(found.params), base))
    data["network"] = list(data["network"])
    heading = f"# Trial {found.number} of a search on {scenario.name}: {found.value:.3f}, lower is better.\n"
    write_whole(path, heading + yaml.safe_dump(data, sort_keys=False))
