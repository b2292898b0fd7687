"""Flights of the same episode as plain data, for a page that plays them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from passloc_env.arrays import Array
from passloc_env.rendering.colours import EMITTER, ESTIMATE, FAINT, GRID, INK, OBSERVER, POLICIES
from passloc_env.rendering.map_panel import ellipse, extent
from passloc_env.rendering.record import Instant
from passloc_env.scenario import Scenario
from training.replay import Recording

_FRAMES = 121
"""Instants of an episode at most; a page is not a film."""

_OUTLINE = 3
"""Of the points of an ellipse every third is enough at the size of a page."""

_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 49)
_MARGIN = 0.06


def played(scenario: Scenario, recordings: Mapping[str, Recording], seed: int) -> dict[str, Any]:
    """What the player needs: per policy the tracks in kilometres, per cent of range for errors, seconds for times.

    Args:
        scenario: the problem.
        recordings: what was flown, by the policy's name; all on the same episode.
        seed: of the episode.
    """
    flown = _thinned({name: recording.instants for name, recording in recordings.items()})
    episode = scenario.episode
    window = _window([instant for instants in flown.values() for instant in instants], episode.min_range)
    return {
        "flights": [_flight(name, instants, episode.min_range) for name, instants in flown.items()],
        "window": window,
        "duration": episode.duration,
        "keep_out": bool(episode.min_range),
        "bearings": any(instant.bearings for instants in flown.values() for instant in instants),
        "colours": {
            "emitter": EMITTER,
            "observer": OBSERVER,
            "estimate": ESTIMATE,
            "faint": FAINT,
            "grid": GRID,
            "ink": INK,
            "policies": POLICIES,
        },
        "seed": seed,
    }


def _thinned(flights: Mapping[str, Sequence[Instant]]) -> dict[str, list[Instant]]:
    """The same instants of all flights, as many as there is room for; of one that ends early also its end."""
    longest = max(map(len, flights.values()))
    grid = np.unique(np.linspace(0, longest - 1, min(_FRAMES, longest)).round().astype(int)).tolist()
    thinned = {}
    for name, instants in flights.items():
        last = len(instants) - 1
        chosen = [index for index in grid if index < last]
        # The frame in which it ended shows its end, wherever between two frames that was.
        thinned[name] = [instants[index] for index in (*chosen, last)]
    return thinned


def _flight(name: str, instants: Sequence[Instant], min_range: float) -> dict[str, Any]:
    emitter = np.array([instant.emitter for instant in instants])
    ring = min_range * np.stack([np.sin(_CIRCLE), np.cos(_CIRCLE)], axis=1)
    return {
        "name": name,
        "time": _numbers(np.array([instant.time for instant in instants]), 1),
        "platforms": [
            _points(np.array([instant.platforms[row] for instant in instants]))
            for row in range(len(instants[0].platforms))
        ],
        "emitter": _points(emitter),
        "estimate": _points(np.array([instant.estimate for instant in instants])),
        "belief": [_points(ellipse(instant)[::_OUTLINE]) for instant in instants],
        "ring": _points(ring),
        "bearings": [_rays(instant) for instant in instants],
        "error": _numbers(100.0 * np.array([instant.error for instant in instants]), 4),
        "bound": _numbers(100.0 * np.array([instant.bound for instant in instants]), 4),
    }


def _rays(instant: Instant) -> list[dict[str, list[float | None]]]:
    """A line from where each bearing was taken, past the emitter."""
    rays = []
    for origin, bearing in instant.bearings:
        reach = 1.5 * float(np.hypot(*(instant.emitter - origin)))
        rays.append(_points(np.array([origin, origin + reach * np.array([np.sin(bearing), np.cos(bearing)])])))
    return rays


def _window(instants: list[Instant], min_range: float) -> dict[str, list[float]]:
    """East and north of all tracks and keep-outs, km; square, so that maps side by side have one scale."""
    points = extent(instants, min_range) / 1e3
    low, high = points.min(axis=0), points.max(axis=0)
    half = (0.5 + _MARGIN) * float((high - low).max())
    middle = 0.5 * (low + high)
    return {
        "east": [float(middle[0] - half), float(middle[0] + half)],
        "north": [float(middle[1] - half), float(middle[1] + half)],
    }


def _points(points: Array) -> dict[str, list[float | None]]:
    """Points ``(k, 2)``, m, as east and north in km."""
    return {"x": _numbers(points[:, 0] / 1e3, 4), "y": _numbers(points[:, 1] / 1e3, 4)}


def _numbers(values: Array, digits: int) -> list[float | None]:
    """Rounded numbers; null for what is not finite, which JSON does not know."""
    return [round(value, digits) if np.isfinite(value) else None for value in values.tolist()]
