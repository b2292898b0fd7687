"""How the error of the estimate falls over an episode, beside the bound on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents import Policy
from passloc_env.arrays import Array
from passloc_env.scenario import Scenario
from training.episodes import Recorder, watch

EPISODES = 200
"""Episodes that a curve is the median of, at most."""

_MEDIAN_OF_NORMAL = 0.6744897501960817
"""Half of all normal errors are smaller than this many deviations."""


@dataclass(frozen=True)
class ErrorCurve:
    """Of one policy, over the time of an episode; ``(steps,)``, per cent of the range.

    Attributes:
        time: seconds.
        error, low, high: median and quartiles of the relative range error.
        bound: what the median error is where the estimate is Gaussian and as good as the Cramér–Rao bound on the range.
    """

    time: Array
    error: Array
    low: Array
    high: Array
    bound: Array


def error_curves(scenario: Scenario, policies: Mapping[str, Policy], episodes: int, seed: int) -> dict[str, ErrorCurve]:
    """A curve of each policy, over the same so many episodes from ``seed`` on."""
    return {name: _curve(scenario, policy, episodes, seed) for name, policy in policies.items()}


def _curve(scenario: Scenario, policy: Policy, episodes: int, seed: int) -> ErrorCurve:
    recorders, _ = watch(Recorder, scenario, policy, episodes, seed)
    error, log_bound = (
        np.concatenate([getattr(recorder, name) for recorder in recorders], axis=1)
        for name in ("error", "log_range_bound")
    )
    low, middle, high = (100.0 * np.quantile(error, share, axis=1) for share in (0.25, 0.5, 0.75))
    time: Array = scenario.episode.period * np.arange(1, len(error) + 1, dtype=float)
    bound: Array = 100.0 * _MEDIAN_OF_NORMAL * np.exp(np.median(log_bound, axis=1))
    return ErrorCurve(time, middle, low, high, bound)
