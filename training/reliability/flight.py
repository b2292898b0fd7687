"""Flying a leg of a soak, and counting what must not happen."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from passloc_env import LocalisationVectorEnv
from passloc_env.arrays import Array, BoolArray
from passloc_env.errors import one_line
from passloc_env.linalg import diagonal, transpose
from training.reliability.leg import Leg

_LONGEST = 100
"""Decisions of a leg at most."""


@dataclass
class Tally:
    """What happened; counts are of environments at decisions, unless said otherwise.

    Attributes:
        legs: how many were flown.
        steps: sensor steps of all environments.
        exceptions: legs that raised anything; a warning counts.
        nonfinite: whose observation, reward, info or belief held a number that is not finite.
        indefinite: whose covariance was not positive definite, or not symmetric to the last bit.
        repairs: covariances repaired and tracks begun anew.
        gated: measurements that gates kept out.
    """

    legs: int = 0
    steps: int = 0
    exceptions: int = 0
    nonfinite: int = 0
    indefinite: int = 0
    repairs: int = 0
    gated: int = 0

    def add(self, other: Tally) -> None:
        """Count what another has counted."""
        for name, count in vars(other).items():
            setattr(self, name, getattr(self, name) + count)

    @property
    def sound(self) -> bool:
        """Whether nothing went wrong but what was repaired."""
        return not (self.exceptions or self.nonfinite or self.indefinite)


def fly_leg(leg: Leg, steps: int, tell: Callable[[str], None]) -> Tally:
    """Fly a leg for so many sensor steps of all environments, or as long as a leg lasts.

    Args:
        leg: what is flown.
        steps: after how many it is enough.
        tell: called with one line for anything that must not happen.
    """
    tally = Tally(legs=1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            _fly(leg, steps, tally)
    except Exception as error:
        tally.exceptions += 1
        tell(f"{type(error).__name__}: {one_line(error)}")
    if tally.nonfinite:
        tell(f"{tally.nonfinite} times a number is not finite")
    if tally.indefinite:
        tell(f"{tally.indefinite} covariances are not positive definite")
    return tally


def _fly(leg: Leg, steps: int, tally: Tally) -> None:
    env = LocalisationVectorEnv(leg.environments, leg.scenario, autoreset_mode=leg.mode, diagnostics=True)
    observation, info = env.reset(seed=int(leg.rng.integers(2**31)))
    ended, before = np.zeros(leg.environments, bool), _Counts(info)
    _judge(env, (observation, info), tally)
    for _ in range(_LONGEST):
        resetting = ended if leg.mode == "NextStep" else np.zeros_like(ended)
        observation, reward, terminated, truncated, info = env.step(leg.actions())
        ended, now = terminated | truncated, _Counts(info)
        tally.steps += int(np.sum(~resetting)) * leg.scenario.episode.decision_every
        _judge(env, (observation, reward, info), tally)
        last = _Counts(info["final_info"]) if "final_info" in info else None
        tally.repairs += now.since(before, last, ended, "repairs")
        tally.gated += now.since(before, last, ended, "gated")
        before = now
        if tally.steps >= steps:
            return


class _Counts:
    """The counters of every environment's track at a decision."""

    def __init__(self, info: Mapping[str, Any]) -> None:
        self.counts = {name: np.asarray(info[name]) for name in ("repairs", "gated")}

    def since(self, before: _Counts, last: _Counts | None, ended: BoolArray, name: str) -> int:
        """How much a counter has grown; those of a new episode begin at zero.

        Args:
            before: a decision ago.
            last: at the end of the episodes that have just ended, where these have begun anew already.
            ended: which have just ended ``(N,)``.
            name: of the counter.
        """
        now = self.counts[name]
        held = now if last is None else np.where(ended, last.counts[name], now)
        grown = held - before.counts[name]
        return int(np.where(grown < 0, held, grown).sum())


def _judge(env: LocalisationVectorEnv, told: tuple[Any, ...], tally: Tally) -> None:
    """Count what must not be in what was told, the info behind, and in beliefs; in those of ended episodes as well."""
    belief, info = env.belief, told[-1]
    finite = _finite((*told, np.moveaxis(belief.mean, -1, 0), np.moveaxis(belief.covariance, -1, 0)))
    spoilt = indefinite(belief.covariance)
    if "final_info" in info:
        spoilt |= info["_final_info"] & indefinite(np.moveaxis(info["final_info"]["covariance"], 0, -1))
    tally.nonfinite += int(np.sum(~finite))
    tally.indefinite += int(np.sum(spoilt))


def _finite(told: Any) -> BoolArray:
    """Whose numbers are all finite ``(N,)``, in arrays ``(N, …)`` however deep; None where there are none."""
    if not isinstance(told, np.ndarray):
        parts = told.values() if isinstance(told, Mapping) else told
        return np.logical_and.reduce([_finite(part) for part in parts])
    if told.dtype == object:
        return np.array([each is None or bool(np.isfinite(each).all()) for each in told])
    finite: BoolArray = np.logical_and.reduce(np.isfinite(told.reshape(len(told), -1)), axis=1)
    return finite


def indefinite(covariance: Array) -> BoolArray:
    """Which covariances ``(n, n, N)`` are not symmetric to the last bit or not positive definite ``(N,)``.

    Scaled to correlations, one that is has positive eigenvalues alone.
    """
    variance = diagonal(covariance)
    symmetric = (covariance == transpose(covariance)).all(axis=(0, 1))
    positive = symmetric & np.isfinite(covariance).all(axis=(0, 1)) & (variance > 0.0).all(axis=0)
    sigma = np.sqrt(np.where(positive, variance, 1.0))
    correlation = np.where(positive, covariance, np.eye(len(covariance))[..., None]) / sigma[:, None] / sigma[None]
    smallest = np.linalg.eigvalsh(np.moveaxis(correlation, -1, 0))[:, 0]
    spoilt: BoolArray = ~(positive & (smallest > 0.0))
    return spoilt
