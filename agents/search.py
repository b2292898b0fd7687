"""Searches for the best controls, batched over environments.

Controls lie in [-1, 1] per component; periodic ones, such as headings in half turns, meet at the ends. A cost takes
candidates ``(C, K, N)``, K for each of N environments, and returns ``(K, N)``. Every environment is searched
for itself: nothing here looks sideways along the last axis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from passloc_env.arrays import Array, BoolArray
from passloc_env.linalg import tree_sum

Cost = Callable[[Array], Array]

_NARROWEST = 0.01
"""Least spread of a generation: elites that agree by chance must not end the search."""


def fold(controls: Array, periodic: BoolArray) -> Array:
    """Controls ``(C, K, N)`` within [-1, 1]: around the circle where ``periodic (C,)``, else to the nearer end."""
    clipped = np.minimum(np.maximum(controls, -1.0), 1.0)
    return np.where(periodic[:, None, None], _around(controls), clipped)


def _around(controls: Array) -> Array:
    return controls - 2.0 * np.rint(0.5 * controls)


def coordinate_search(cost: Cost, grid: Array, start: Array, sweeps: int) -> Array:
    """The best controls ``(C, N)`` on a grid, one component at a time; exhaustive where there is only one.

    Args:
        cost: what to minimise.
        grid: values that each component may take ``(C, K)``.
        start: values ``(C, N)`` of the components that have not had their turn yet.
        sweeps: how often each component has its turn.
    """
    best = start.copy()
    for _ in range(sweeps if len(grid) > 1 else 1):
        for component, values in enumerate(grid):
            candidates = np.repeat(best[:, None], len(values), axis=1)
            candidates[component] = values[:, None]
            choice = np.argmin(cost(candidates), axis=0)
            best[component] = values[choice]
    return best


def cross_entropy(cost: Cost, first: Array, samples: Array, elites: int, periodic: BoolArray) -> Array:
    """The best controls ``(C, N)`` found by the cross-entropy method (Rubinstein & Kroese 2004, ch. 2).

    Each generation is normal, with the mean and the standard deviation of the best candidates of the one before;
    deviations are taken from the very best one, so that headings average around the circle. The best candidate of all
    generations wins.

    Args:
        cost: what to minimise.
        first: the first generation ``(C, K, N)``.
        samples: standard normals of the later ones ``(generations, C, K')``, the same for all environments.
        elites: how many of the best found the next generation.
        periodic: which components are periodic ``(C,)``.
    """
    population, costs = first, cost(first)
    best, least = _best(population, costs)
    for normals in samples:
        centre, spread = _elite(population, costs, elites, periodic)
        population = fold(centre + spread * normals[..., None], periodic)
        costs = cost(population)
        challenger, value = _best(population, costs)
        best, least = np.where(value < least, challenger, best), np.minimum(value, least)
    return best


def _best(population: Array, costs: Array) -> tuple[Array, Array]:
    """The best candidates ``(C, N)`` and their costs ``(N,)``."""
    choice = np.argmin(costs, axis=0)[None]
    return np.take_along_axis(population, choice[None], axis=1)[:, 0], np.take_along_axis(costs, choice, axis=0)[0]


def _elite(population: Array, costs: Array, count: int, periodic: BoolArray) -> tuple[Array, Array]:
    """Mean and standard deviation ``(C, 1, N)`` of the best candidates."""
    order = np.argsort(costs, axis=0, kind="stable")[:count]
    elite = np.take_along_axis(population, order[None], axis=1)
    lead = elite[:, :1]
    away = elite - lead
    away = np.where(periodic[:, None, None], _around(away), away)
    mean = tree_sum(away.swapaxes(0, 1).copy())[:, None] / len(order)
    variance = tree_sum(np.square(away - mean).swapaxes(0, 1))[:, None] / len(order)
    return lead + mean, np.maximum(np.sqrt(variance), _NARROWEST)
