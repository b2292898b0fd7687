"""Searching hyperparameters: trial after trial is trained and judged, and the best found so far is written down."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import optuna
import yaml
from optuna.trial import TrialState

from agents import LearnedPolicy
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import at_least_one, check_seed, kept_folder, parse_overrides
from training.commands import Tune
from training.episodes import fly
from training.files import write_whole
from training.hyperparameters import Hyperparameters
from training.progress import console, progress_bar
from training.score import score_of
from training.search_space import suggest, unchanged
from training.study import ask, best_trial, opened_study
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
            another search.
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
    with opened_study(folder / "study.db", settings, base.decisions) as study, progress_bar("trials") as bar:
        task = bar.add_task(f"searching on {scenario.name}", total=arguments.trials)
        for _ in range(arguments.trials):
            trial = ask(study, arguments.seed, unchanged(base))
            said = _try(study, trial, scenario, base, arguments)
            console.print(f"trial {trial.number}: {said}", highlight=False, soft_wrap=True)
            _write_best(study, base, scenario, best)
            bar.advance(task)
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


def _try(study: optuna.Study, trial: optuna.Trial, scenario: Scenario, base: Hyperparameters, arguments: Tune) -> str:
    """Bring one trial to its end; what came of it, in words."""

    def watch(row: dict[str, float]) -> None:
        # The search minimises, so pruners take what is reported for a cost.
        trial.report(-row["mean_return"], step=int(row["decisions"]))
        if trial.should_prune():
            raise optuna.TrialPruned(f"in the worst quarter after {row['decisions']:,.0f} decisions")

    try:
        cost = _cost(scenario, suggest(trial, base), arguments, watch)
    except (optuna.TrialPruned, ValueError) as error:
        # A diverging learner ends as a ValueError of its normal distribution; to the sampler it counts as the worst.
        study.tell(trial, state=TrialState.PRUNED)
        return f"given up: {str(error).partition(chr(10))[0]}"
    study.tell(trial, cost)
    return f"{cost:.3f}"


def _cost(
    scenario: Scenario, parameters: Hyperparameters, arguments: Tune, watch: Callable[[dict[str, float]], None]
) -> float:
    """What the scenario's score says of an agent trained so, and what its violations cost; lower is better."""
    with tempfile.TemporaryDirectory() as folder:
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
