"""What a search may change about the hyperparameters, and how far."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from training.hyperparameters import Hyperparameters

if TYPE_CHECKING:
    from optuna.trial import BaseTrial

_BATCHES = (4, 8, 16, 32)
"""Gradient steps per epoch worth trying beside the base's own."""


def suggest(trial: BaseTrial, base: Hyperparameters) -> Hyperparameters:
    """The base with what is searched replaced by a trial's suggestions.

    Rates are searched on a logarithmic scale, the discount by its distance from one. The batch size is searched by the
    number of batches that a rollout is cut into, so that every batch is whole. Nothing is discounted where the base
    discounts nothing: what counts there is the end.
    """
    rollout = base.environments * base.rollout
    batches = sorted({count for count in _BATCHES if rollout % count == 0} | {rollout // base.batch_size})
    widening = trial.suggest_categorical("widening", [0.5, 1.0, 2.0])
    return dataclasses.replace(
        base,
        learning_rate=trial.suggest_float("learning_rate", 3e-4, 3e-3, log=True),
        discount=1.0 if base.discount == 1.0 else 1.0 - trial.suggest_float("one_minus_discount", 2e-3, 1e-1, log=True),
        trace_decay=trial.suggest_float("trace_decay", 0.9, 0.99),
        epochs=trial.suggest_int("epochs", 2, 12),
        batch_size=rollout // trial.suggest_categorical("batches", batches),
        initial_log_sigma=trial.suggest_float("initial_log_sigma", -2.0, 0.0),
        network=tuple(round(widening * width) for width in base.network),
    )


def unchanged(base: Hyperparameters) -> dict[str, Any]:
    """The suggestions with which :func:`suggest` gives the base itself."""
    return {
        "widening": 1.0,
        "learning_rate": base.learning_rate,
        "one_minus_discount": 1.0 - base.discount,
        "trace_decay": base.trace_decay,
        "epochs": base.epochs,
        "batches": base.environments * base.rollout // base.batch_size,
        "initial_log_sigma": base.initial_log_sigma,
    }
