"""Where the searches start: the manoeuvres of the textbooks, to either side, and random ones.

Random starts matter: on short problems they find turns first one way and then the other that no recipe leads to.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from passloc_env.angles import bearing_of, wrap
from passloc_env.arrays import Array
from passloc_env.units import DEGREE
from training.optimum.future import Future

_TURN = 30 * DEGREE
"""Largest turn per decision of a circle or a random course."""

Wish = Callable[[float, Array], Array]
"""A heading relative to the true line of sight ``(N,)``, rad, from the share of the episode that is over and the
heading now."""


def _zigzag(degrees: float, legs: int, side: float) -> Wish:
    """Legs alternately to either side."""
    return lambda share, now: np.full(now.shape, side * degrees * DEGREE * (-1.0) ** int(share * legs))


def _circle(side: float) -> Wish:
    """Always further round; slower platforms turn as far as they can."""
    return lambda share, now: now + side * _TURN


def _reversal(at: float, side: float) -> Wish:
    """A circle to one side, then one to the other."""
    return lambda share, now: now + (side if share < at else -side) * _TURN


def _dog_leg(degrees: float, at: float, side: float) -> Wish:
    """One leg to one side, the other to the opposite one."""
    return lambda share, now: np.full(now.shape, (side if share < at else -side) * degrees * DEGREE)


def _recipes() -> list[Wish]:
    """The most fruitful first; each is followed by its mirror image."""
    kinds: list[Callable[[float], Wish]] = [
        lambda side: _zigzag(60.0, 6, side),
        lambda side: _dog_leg(90.0, 0.4, side),
        lambda side: _circle(side),
        lambda side: _reversal(0.3, side),
    ]
    return [kind(side) for kind in kinds for side in (1.0, -1.0)]


RECIPES = _recipes()
"""Starts by the book; any further ones are random."""


def starting_turns(future: Future, restarts: int, seeds: Sequence[int], seed: int) -> Array:
    """Turns ``(D, restarts, N)``, rad, to begin searches from.

    Args:
        future: the episodes.
        restarts: how many; beyond the :data:`RECIPES` they are random courses.
        seeds: of the episodes; a random start depends on its episode's and on ``seed`` alone.
        seed: of the random starts.
    """
    known = [_by_the_book(future, wish) for wish in RECIPES[:restarts]]
    random = [_at_random(future, index, seeds, seed) for index in range(len(known), restarts)]
    return np.stack(known + random, axis=1)


def _by_the_book(future: Future, wish: Wish) -> Array:
    """The turns ``(D, N)`` that follow a recipe, with the line of sight from where the observer starts."""
    limit = np.minimum(future.largest_turn, np.pi)
    every = future.scenario.episode.decision_every
    heading, turns = future.heading, []
    for decision in range(future.decisions):
        emitter = future.truth[future.layout.position, decision * every]
        sight = bearing_of(emitter - future.position)
        wanted = sight + wish(decision / future.decisions, heading - sight)
        turns.append(np.clip(wrap(wanted - heading), -limit, limit))
        heading = heading + turns[-1]
    return np.stack(turns)


def _at_random(future: Future, index: int, seeds: Sequence[int], seed: int) -> Array:
    """A random course ``(D, N)``: turns, often the largest, whose correlation fades over a sixth of the episode."""
    fade = float(np.exp(-6.0 / future.decisions))
    limit = np.minimum(future.largest_turn, _TURN)
    turns = np.zeros((future.decisions, len(seeds)))
    for column, episode in enumerate(seeds):
        normals = np.random.default_rng((seed, index, int(episode))).standard_normal(future.decisions)
        level = normals[0]
        for decision, normal in enumerate(normals):
            level = fade * level + np.sqrt(1.0 - fade * fade) * normal
            turns[decision, column] = level
    return np.clip(1.5 * turns, -1.0, 1.0) * limit
