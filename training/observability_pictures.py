"""A survey as a picture: the bound over emitter positions, and along time."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from passloc_env.arrays import Array
from passloc_env.frames import from_geodetic, geodetic
from passloc_env.platforms import CircularOrbit
from passloc_env.survey import Survey
from training.pictures import BOUND, EMITTER, OBSERVER

_CELLS = 61
_MARGIN = 1.3
"""The map reaches this much further than the emitter."""

_DEGREES_AROUND = 10.0
"""Half the width of a map on the globe."""

_FLOOR = 1e-3
"""Values below this share of the map's largest get one colour."""


class _Map(NamedTuple):
    """A grid of emitter positions and how to draw it.

    Attributes:
        across, along: coordinates of the cells' centres, in the unit of the axes.
        positions: ``(d, cells)``, m, row by row.
        project: from positions ``(d, k)`` to the axes ``(2, k)``.
        labels: of the axes.
    """

    across: Array
    along: Array
    positions: Array
    labels: tuple[str, str]
    globe: bool

    def project(self, positions: Array) -> Array:
        """Positions ``(d, k)`` on the axes ``(2, k)``."""
        if self.globe:
            place = geodetic(positions)
            return np.degrees(np.stack([place.longitude, place.latitude]))
        return positions[:2] / 1e3


def draw_survey(survey: Survey, title: str, path: Path) -> None:
    """The map on the left, the bound of this episode's emitter over time on the right."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12.0, 5.2), width_ratios=(1.25, 1.0), layout="constrained")
    _draw_map(left, survey)
    _draw_time(right, survey)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _grid(survey: Survey) -> _Map:
    start = survey.start[survey.layout.position]
    if any(isinstance(platform, CircularOrbit) for platform in survey.scenario.platforms):
        place = geodetic(start)
        longitude, latitude = (
            np.degrees(angle[0]) + np.linspace(-_DEGREES_AROUND, _DEGREES_AROUND, _CELLS)
            for angle in (place.longitude, place.latitude)
        )
        grid = np.meshgrid(np.radians(longitude), np.radians(latitude))
        positions = from_geodetic(grid[1].ravel(), grid[0].ravel(), np.full(_CELLS**2, place.height[0]))
        return _Map(longitude, latitude, positions, ("longitude, °", "latitude, °"), globe=True)
    own = np.mean([poses[survey.scenario.own_ship].position[:2, 0] for poses in survey.path], axis=0)
    reach = _MARGIN * float(np.hypot(*(start[:2, 0] - own)))
    east, north = (centre + np.linspace(-reach, reach, _CELLS) for centre in own)
    grid = np.meshgrid(east, north)
    positions = np.repeat(start, _CELLS**2, axis=1)
    positions[0], positions[1] = grid[0].ravel(), grid[1].ravel()
    return _Map(east / 1e3, north / 1e3, positions, ("east, km", "north, km"), globe=False)


def _draw_map(axes: Axes, survey: Survey) -> None:
    chart = _grid(survey)
    bound = survey.bound_elsewhere(chart.positions).reshape(_CELLS, _CELLS)
    lowest = max(float(bound.min()), _FLOOR * float(bound.max()))
    colours = axes.pcolormesh(
        chart.across, chart.along, bound, norm=LogNorm(lowest, float(bound.max())), cmap="cividis", shading="nearest"
    )
    axes.figure.colorbar(colours, ax=axes, label="bound on the position at the end, m")
    for index in range(len(survey.scenario.platforms)):
        flown = chart.project(np.concatenate([poses[index].position for poses in survey.path], axis=1))
        axes.plot(*flown, color="white", lw=4.0)
        axes.plot(*flown, color=OBSERVER, lw=2.0, label="observer" if index == 0 else None)
        axes.plot(*flown[:, :1], "o", color=OBSERVER, mec="white", ms=8)
    emitter = chart.project(survey.states[:, survey.layout.position].T)
    axes.plot(*emitter, color="white", lw=4.0)
    axes.plot(*emitter, color=EMITTER, lw=2.0, label="emitter of this episode")
    axes.plot(*chart.project(survey.start[survey.layout.position]), "o", color=EMITTER, mec="white", ms=8)
    axes.set_title("for an emitter that starts here")
    axes.set_xlabel(chart.labels[0])
    axes.set_ylabel(chart.labels[1])
    axes.set_xlim(chart.across[0], chart.across[-1])
    axes.set_ylim(chart.along[0], chart.along[-1])
    if not chart.globe:
        axes.set_aspect("equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)


def _draw_time(axes: Axes, survey: Survey) -> None:
    axes.semilogy(survey.time, survey.position_bound, color=BOUND, lw=2.0, label="bound on the position")
    axes.semilogy(survey.time, survey.range, color=OBSERVER, lw=1.5, ls="--", label="range")
    axes.set_xlabel("time, s")
    axes.set_ylabel("m")
    axes.set_title("for the emitter of this episode")
    axes.grid(alpha=0.3, which="both")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)
