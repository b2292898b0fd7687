"""The memory of a search: an Optuna study in an SQLite file, which a later search goes on from."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.trial import TrialState
from sqlalchemy import URL
from sqlalchemy.exc import SQLAlchemyError

from passloc_env.errors import InputError, one_line

_NAME, _SETTINGS = "passloc", "settings"
_PROGRAMS = "SELECT count(*) FROM sqlite_master WHERE type IN ('trigger', 'view')"
_DONE = (TrialState.COMPLETE, TrialState.PRUNED)
_HOPELESS, _FAIR_TRIALS = 75.0, 5
"""Training is given up in the worst quarter, once so many trials have been through to compare with."""


@contextmanager
def opened_study(path: Path, settings: dict[str, Any]) -> Iterator[optuna.Study]:
    """A study begun now or earlier; only one search at a time may work on it, which holds its folder.

    Trials that an interrupted search left running are marked as failed: samplers and pruners pass over those.

    Args:
        path: the SQLite file.
        settings: all that costs depend on beside the suggestions, as plain data; trials of different settings cannot
            be compared.

    Raises:
        InputError: the file is no study, cannot be opened, or holds trials of other settings.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    _refuse_programs(path)
    try:
        storage = optuna.storages.RDBStorage(URL.create("sqlite", database=str(path)).render_as_string())
        study = optuna.create_study(storage=storage, study_name=_NAME, load_if_exists=True)
    except (SQLAlchemyError, optuna.exceptions.OptunaError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{path} cannot be used as the memory of a search: {reason}") from None
    try:
        _keep_to(settings, study, path)
        for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            study.tell(trial.number, state=TrialState.FAIL)
        yield study
    finally:
        storage.remove_session()
        storage.engine.dispose()


def _refuse_programs(path: Path) -> None:
    """InputError for a database that does something by itself when it is written to: Optuna's have no triggers."""
    if not path.is_file():
        return
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            (programs,) = database.execute(_PROGRAMS).fetchone()
    except sqlite3.Error as error:
        raise InputError(f"{path} cannot be used as the memory of a search: {one_line(error)}") from None
    if programs:
        raise InputError(f"{path} cannot be used as the memory of a search: it holds triggers or views")


def _keep_to(settings: dict[str, Any], study: optuna.Study, path: Path) -> None:
    """InputError unless the study is new or of the same settings."""
    found = study.user_attrs.get(_SETTINGS)
    if not study.user_attrs and not study.trials:
        # At once: a search that is killed in between would be one of other settings for ever.
        study.set_user_attr(_SETTINGS, settings)
        return
    known = found if isinstance(found, dict) else {}
    other = [name for name, value in settings.items() if known.get(name) != value]
    if other:
        raise InputError(f"{path} is a search with other {', '.join(other)}: name another folder with --out")


def ask(study: optuna.Study, seed: int, first: dict[str, Any], beside: int = 0) -> optuna.Trial:
    """The next trial, whose suggestions are to be taken before another one is asked for.

    They follow from the seed and the trials that were brought to an end: a search that is interrupted and taken up
    again comes to what it would have come to in one go.

    Args:
        study: what has been tried.
        seed: of the search.
        first: the suggestions to begin with.
        beside: how many trials have been asked for and not yet been told of.
    """
    done = len(study.get_trials(deepcopy=False, states=_DONE)) + beside
    if not done and not study.get_trials(deepcopy=False, states=(TrialState.WAITING,)):
        study.enqueue_trial(first)
    drawn = np.random.SeedSequence((seed, done)).generate_state(1)
    study.sampler = optuna.samplers.TPESampler(seed=int(drawn[0]))
    return study.ask()


def completed(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """The trials that have been through, as plain data."""
    return study.get_trials(states=(TrialState.COMPLETE,))


def rehearsed(earlier: Sequence[optuna.trial.FrozenTrial], decisions: int) -> optuna.Trial:
    """A trial outside any file, which says whether it is to be given up beside those that have been through.

    Args:
        earlier: as :func:`completed` gives them.
        decisions: how many a whole trial trains for; none is given up in the first half.
    """
    pruner = optuna.pruners.PercentilePruner(_HOPELESS, n_startup_trials=_FAIR_TRIALS, n_warmup_steps=decisions // 2)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(pruner=pruner)
    study.add_trials(earlier)
    return study.ask()


def best_trial(study: optuna.Study) -> optuna.trial.FrozenTrial | None:
    """The trial of the lowest cost, if any has been through."""
    return study.best_trial if study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)) else None
