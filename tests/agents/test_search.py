"""Searches: exhaustive where that is possible, and every environment for itself."""

import itertools

import numpy as np
import pytest

from agents.search import coordinate_search, cross_entropy, fold

TARGETS = np.array([[0.93, -0.2, 0.5, -0.97], [-0.4, 0.99, 0.1, -0.95]])
"""Where the best controls are ``(2, N)``, some next to the seam of the circle."""


def bowl(periodic):
    """A cost with one minimum, and ripples that have many."""

    def cost(candidates):
        away = candidates - TARGETS[:, None]
        away = np.where(np.reshape(periodic, (2, 1, 1)), away - 2.0 * np.rint(0.5 * away), away)
        return (away**2).sum(axis=0) + 0.02 * (1.0 - np.cos(9.0 * np.pi * away)).sum(axis=0)

    return cost


def test_a_grid_of_one_component_is_searched_exhaustively():
    grid = np.linspace(-1.0, 1.0, 21)[None]
    curves = np.random.default_rng(0).standard_normal((21, 50))
    asked = []

    def cost(candidates):
        asked.append(candidates.shape)
        return curves[np.rint(10.0 * candidates[0] + 10.0).astype(int), np.arange(50)]

    best = coordinate_search(cost, grid, np.zeros((1, 50)), sweeps=3)
    assert (best[0] == grid[0, curves.argmin(axis=0)]).all()
    assert asked == [(1, 21, 50)]


def test_coordinates_in_turn_reach_the_best_of_the_whole_grid_of_a_bowl():
    """A separable cost: the 41² pairs hold nothing better."""
    grid = np.stack([np.linspace(-1.0, 1.0, 41)] * 2)
    periodic = np.array([False, True])
    pairs = np.array(list(itertools.product(*grid))).T[..., None] * np.ones(4)
    least = bowl(periodic)(pairs).min(axis=0)
    best = coordinate_search(bowl(periodic), grid, np.zeros((2, 4)), sweeps=1)
    assert (bowl(periodic)(best[:, None])[0] <= least + 1e-15).all()


@pytest.mark.parametrize("periodic", [(True, True), (False, False), (True, False)])
def test_cross_entropy_finds_what_exhaustive_search_finds(periodic):
    """Against a grid with steps of 0.02: no worse than its best, whose cost rounding to the grid has raised."""
    periodic = np.array(periodic)
    cost = bowl(periodic)
    rng = np.random.default_rng(1)
    first = np.repeat(rng.uniform(-1.0, 1.0, (2, 60, 1)), 4, axis=2)
    found = cross_entropy(cost, first, rng.standard_normal((12, 2, 60)), 8, periodic)
    grid = np.array(list(itertools.product(np.linspace(-1.0, 1.0, 101), repeat=2))).T[..., None] * np.ones(4)
    assert (cost(found[:, None])[0] <= cost(grid).min(axis=0) + 1e-3).all()
    assert np.abs(found).max() <= 1.0


def test_more_generations_are_never_worse():
    periodic = np.array([True, True])
    cost, rng = bowl(periodic), np.random.default_rng(2)
    first, normals = np.repeat(rng.uniform(-1.0, 1.0, (2, 30, 1)), 4, axis=2), rng.standard_normal((6, 2, 20))
    values = [cost(cross_entropy(cost, first, normals[:g], 5, periodic)[:, None])[0] for g in range(7)]
    assert (np.diff(values, axis=0) <= 0.0).all()
    assert (values[-1] < values[0]).all()
    assert (values[0] == cost(first).min(axis=0)).all()


def test_a_cost_that_is_infinite_somewhere_is_avoided_and_everywhere_survived():
    periodic = np.array([True, True])
    rng = np.random.default_rng(3)
    first, normals = np.repeat(rng.uniform(-1.0, 1.0, (2, 30, 1)), 4, axis=2), rng.standard_normal((3, 2, 20))
    half = cross_entropy(lambda c: np.where(c[0] > 0.0, np.inf, -c[0]), first, normals, 5, periodic)
    assert (half[0] <= 0.0).all()
    nowhere = cross_entropy(lambda c: np.full(c.shape[1:], np.inf), first, normals, 5, periodic)
    assert np.isfinite(nowhere).all()


def test_environments_are_searched_for_themselves():
    periodic = np.array([True, False])
    rng = np.random.default_rng(4)
    first, normals = np.repeat(rng.uniform(-1.0, 1.0, (2, 30, 1)), 4, axis=2), rng.standard_normal((4, 2, 20))
    together = cross_entropy(bowl(periodic), first, normals, 5, periodic)
    for column in range(4):

        def alone(candidates, column=column):
            return bowl(periodic)(np.repeat(candidates, 4, axis=2))[:, column : column + 1]

        one = cross_entropy(alone, first[..., :1], normals, 5, periodic)
        assert one.tobytes() == together[:, column : column + 1].copy().tobytes()


def test_fold():
    controls = np.array([[1.2, -1.5, 3.0, 0.3], [1.2, -1.5, 3.0, 0.3]])[:, None]
    folded = fold(controls, np.array([True, False]))[:, 0]
    np.testing.assert_allclose(folded, [[-0.8, 0.5, -1.0, 0.3], [1.0, -1.0, 1.0, 0.3]], atol=1e-15)
