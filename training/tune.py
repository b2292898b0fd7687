"""Searching hyperparameters with Optuna; trials are remembered in an SQLite file, and the search goes on from it."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from agents import LearnedPolicy
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from training.arguments import check_seed, parse_overrides, read_scenario
from training.commands import Tune
from training.episodes import fly
from training.hyperparameters import Hyperparameters
from training.progress import console
from training.train import run

if TYPE_CHECKING:
    import optuna

TUNING_SEED = 3_000_000
"""First seed of the episodes that trials are judged by: neither training seeds nor those of evaluations."""

_VIOLATION_COST = 5.0
"""What one violation per episode would cost in log range bound: one in a hundred counts .05."""


def tune(arguments: Tune) -> optuna.Study:
    """Run more trials of a study, begun now or earlier, and write the best hyperparameters found so far.

    Raises:
        InputError: a number of trials, episodes or decisions below one.
    """
    import optuna

    scenario = read_scenario(arguments.scenario).override(parse_overrides(arguments.override))
    check_seed(arguments.seed)
    for name in ("trials", "decisions", "episodes"):
        if getattr(arguments, name) < 1:
            raise InputError(f"{name} = {getattr(arguments, name)} is not possible: must be at least 1")
    base = dataclasses.replace(Hyperparameters.for_scenario(scenario.name), decisions=arguments.decisions)
    folder = arguments.out or Path("runs") / "tune" / scenario.name
    folder.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        study_name=scenario.name,
        storage=f"sqlite:///{folder / 'study.db'}",
        load_if_exists=True,
        # The trials done so far are part of the seed, so that a search taken up again does not repeat itself.
        sampler=optuna.samplers.TPESampler(seed=arguments.seed),
    )
    _seed_anew(study, arguments.seed)

    def objective(trial: optuna.Trial) -> float:
        return _judge(scenario, suggest(trial, base), arguments)

    def report(study: optuna.Study, trial: optuna.trial.FrozenTrial) -> None:
        console.print(f"trial {trial.number}: {trial.value:.3f}, best so far {study.best_value:.3f}", highlight=False)
        write_best(study, base, folder / "best.yaml")

    study.optimize(objective, n_trials=arguments.trials, callbacks=[report])
    console.print(f"{len(study.trials)} trials; the best hyperparameters are in {folder / 'best.yaml'}")
    return study


def _seed_anew(study: optuna.Study, seed: int) -> None:
    import optuna

    study.sampler = optuna.samplers.TPESampler(seed=seed + len(study.trials))


def suggest(trial: optuna.Trial, base: Hyperparameters) -> Hyperparameters:
    """The base with what is searched replaced by a trial's suggestions."""
    return dataclasses.replace(
        base,
        learning_rate=trial.suggest_float("learning_rate", 3e-4, 3e-3, log=True),
        discount=1.0 - trial.suggest_float("one_minus_discount", 2e-3, 5e-2, log=True),
        trace_decay=trial.suggest_float("trace_decay", 0.9, 0.99),
        epochs=trial.suggest_int("epochs", 4, 12),
        batch_size=trial.suggest_categorical("batch_size", [512, 1024, 2048, 4096]),
        initial_log_sigma=trial.suggest_float("initial_log_sigma", -2.0, 0.0),
        network=(trial.suggest_categorical("width", [32, 64, 128]),) * 2,
    )


def _judge(scenario: Scenario, parameters: Hyperparameters, arguments: Tune) -> float:
    """Log range bound of an agent trained so, with what its violations cost; lower is better."""
    with tempfile.TemporaryDirectory() as folder:
        finished = run(scenario, parameters, Path(folder), arguments.seed, quiet=True)
    scores, _ = fly(scenario, LearnedPolicy(finished.agent), arguments.episodes, TUNING_SEED)
    return float(scores.log_range_bound.mean() + _VIOLATION_COST * scores.violated.mean())


def write_best(study: optuna.Study, base: Hyperparameters, path: Path) -> None:
    """Write the hyperparameters of the best trial as a YAML file that ``passloc train --hyperparameters`` takes."""
    import optuna

    best = suggest(optuna.trial.FixedTrial(study.best_params), base)  # type: ignore[arg-type]
    data: dict[str, Any] = dataclasses.asdict(best)
    data["network"] = list(best.network)
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
