"""Searching the best path of every episode, from many starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.errors import InputError, unknown_name
from passloc_env.scenario import Scenario
from training.optimum.bound import OBJECTIVES, Problem
from training.optimum.descent import Found, descend, judge
from training.optimum.future import EPISODES, Future, check, foresee
from training.optimum.optimum import Optimum, Settings
from training.optimum.path import headings
from training.optimum.starts import starting_turns

_COLUMNS = 2048
"""Paths searched at once: a few hundred megabytes with 60 decisions."""

_FINALISTS = 2
"""Restarts of each episode that are polished."""

_STEP, _POLISHING_STEP = 0.1, 0.03
"""Adam's first step in the search and in the polish, as a share of the largest turn."""

_SOFT = 0.1
"""The penalty's weight at the beginning of the search."""


def optimise(
    scenario: Scenario,
    seeds: Sequence[int],
    restarts: int = 16,
    iterations: int = 200,
    polish: int = 60,
    seed: int = 0,
    objective: str = "log_range_bound",
    cache: Path | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Optimum:
    """Minimise the Cramér–Rao bound along the path of the observer, given the realised future of the emitter.

    Every restart is a descent with the measurements of a decision counted as one; the best two of each episode are
    then polished with all measurements, and everything reported is evaluated with all of them.

    Args:
        scenario: one turn-limited platform under heading control, with sensors that never miss.
        seeds: of the episodes, each named once.
        restarts: descents per episode; the first are manoeuvres by the book, see :mod:`training.optimum.starts`.
        iterations: gradient steps per descent.
        polish: gradient steps of the polish.
        seed: of the random starts.
        objective: ``log_range_bound`` (mean over time of ``ln(σ_r / r)``), or ``end_position_bound`` (root of the
            trace of the position at the end, m): the scores of :class:`training.episodes.Scores` by these names.
        cache: a file to keep the result in; when it holds this very search, it is read instead.
        progress: called with the number of episodes finished since the last call.

    Raises:
        ScenarioError: a scenario beyond these means.
        InputError: impossible numbers, an unknown objective, or a cache that holds something else.
    """
    settings = Settings(objective, restarts, iterations, polish, seed)
    check(scenario)
    _check(settings, seeds)
    if cache is not None and cache.exists():
        return _cached(cache, scenario, settings, seeds)
    at_once = min(EPISODES, max(1, _COLUMNS // restarts))
    parts = []
    with _one_thread():
        for first in range(0, len(seeds), at_once):
            some = seeds[first : first + at_once]
            parts.append(_search(foresee(scenario, some), some, settings))
            progress(len(some))
    joined = {name: np.concatenate([getattr(p, name) for p in parts], axis=_AXES[name]) for name in _AXES}
    optimum = Optimum(scenario, settings, np.array(seeds, np.int64), **joined)
    if cache is not None:
        optimum.save(cache)
    return optimum


class _Part(NamedTuple):
    """What some episodes came to, as in :class:`Optimum`."""

    headings: Array
    paths: Array
    values: Array
    legal: BoolArray
    chosen: IntArray


_AXES = {"headings": 0, "paths": 2, "values": 0, "legal": 0, "chosen": 0}


def _search(future: Future, seeds: Sequence[int], settings: Settings) -> _Part:
    """Descend from every start, polish the best, and choose."""
    shape = (future.decisions, settings.restarts, future.episodes)
    wide = future.take(np.tile(np.arange(future.episodes), settings.restarts))
    starts = starting_turns(future, settings.restarts, seeds, settings.seed).reshape(shape[0], -1)
    rough = Problem(wide, settings.objective, lumped=True)
    found = descend(rough, torch.from_numpy(starts), settings.iterations, _STEP, _SOFT)
    exact = judge(Problem(wide, settings.objective), found.turns)
    if settings.polish:
        exact = _polished(future, exact, settings)

    values, legal = (part.numpy().reshape(shape[1:]) for part in exact[1:])
    chosen = np.argmin(_rank(values, legal), axis=0)
    episodes = np.arange(future.episodes)
    turns = exact.turns.reshape(shape)[:, torch.from_numpy(chosen), torch.from_numpy(episodes)]
    problem = Problem(future, settings.objective)
    return _Part(
        headings=headings(problem.flyer, turns).numpy().T,
        paths=problem.path(turns).position.numpy(),
        values=(np.exp(values) if settings.objective == "end_position_bound" else values).T,
        legal=legal.T,
        chosen=chosen,
    )


def _polished(future: Future, found: Found, settings: Settings) -> Found:
    """The same with the best of each episode polished."""
    n, finalists = future.episodes, min(_FINALISTS, settings.restarts)
    rank = _rank(found.objective.numpy(), found.legal.numpy()).reshape(-1, n)
    best = np.argsort(rank, axis=0, kind="stable")[:finalists]
    columns = (best * n + np.arange(n)).reshape(-1)
    problem = Problem(future.take(columns % n), settings.objective)
    polished = descend(problem, found.turns[:, columns], settings.polish, _POLISHING_STEP)
    merged = [part.clone() for part in found]
    for whole, part in zip(merged, polished, strict=True):
        whole[..., columns] = part
    return Found(*merged)


def _rank(values: Array, legal: BoolArray) -> Array:
    """Values by which to choose: whatever is legal comes first."""
    return np.where(legal, values, values + 1e3)


def _check(settings: Settings, seeds: Sequence[int]) -> None:
    """Raise InputError, in one line, for a search that cannot be made."""
    if settings.objective not in OBJECTIVES:
        raise unknown_name("objective", settings.objective, OBJECTIVES, "objective")
    for name, least in (("restarts", 1), ("iterations", 0), ("polish", 0), ("seed", 0)):
        if getattr(settings, name) < least:
            raise InputError(f"{name} = {getattr(settings, name)} is not possible: must be at least {least}")
    if not len(seeds) or len(set(seeds)) < len(seeds):
        raise InputError("seeds are not possible: there must be at least one, and each may be named once")


def _cached(path: Path, scenario: Scenario, settings: Settings, seeds: Sequence[int]) -> Optimum:
    """The optimum in a file, if it is the one that is wanted."""
    optimum = Optimum.load(path)
    if optimum.scenario != scenario or optimum.settings != settings or optimum.seeds.tolist() != list(seeds):
        raise InputError(f"cache = {str(path)!r} is not possible: it holds another search; delete it or name another")
    return optimum


@contextmanager
def _one_thread() -> Iterator[None]:
    """Torch on one thread: the tensors are small."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
