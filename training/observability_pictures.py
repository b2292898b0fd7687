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
from matplotlib.patches import Circle as CirclePatch
from matplotlib.ticker import FixedLocator, Locator, LogLocator, MaxNLocator, NullLocator

from passloc_env.arrays import Array
from passloc_env.frames import from_geodetic, geodetic
from passloc_env.platforms import CircularOrbit
from passloc_env.rendering.colours import BLACK, BOUND, EMITTER, ESTIMATE, OBSERVER, PURPLE
from passloc_env.survey import Survey

_CELLS = 61
_MARGIN = 1.3
"""The map reaches this much further than emitter and observers."""

_DEGREES_AROUND = 10.0
"""Half the width of a map on the globe."""

_FLOOR = 1e-3
"""Values below this share of the map's largest get one colour."""

_FLAT, _FEW = 1.05, 4.0
"""Maps whose values differ by smaller factors are nearly constant, or too narrow for ticks at 1, 2, 5, 10."""

_PLATFORMS = ((OBSERVER, "-"), (PURPLE, "--"), (ESTIMATE, ":"), (BLACK, "-."))
"""Colour and line of each platform, in turn: two that fly in file are both seen."""


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
    platforms = [np.stack([pose.position[:2, 0] for pose in poses]) for poses in zip(*survey.path, strict=True)]
    own = platforms[survey.scenario.own_ship].mean(axis=0)
    seen = np.concatenate([start[:2].T, survey.states[:, :2], *platforms])
    reach = _MARGIN * float(np.hypot(*(seen - own).T).max())
    east, north = (centre + np.linspace(-reach, reach, _CELLS) for centre in own)
    grid = np.meshgrid(east, north)
    positions = np.repeat(start, _CELLS**2, axis=1)
    positions[0], positions[1] = grid[0].ravel(), grid[1].ravel()
    return _Map(east / 1e3, north / 1e3, positions, ("east, km", "north, km"), globe=False)


def _draw_map(axes: Axes, survey: Survey) -> None:
    chart = _grid(survey)
    _draw_bound(axes, survey, chart)
    for index in range(len(survey.scenario.platforms)):
        _draw_platform(axes, survey, chart, index)
    _draw_emitter(axes, survey, chart)
    axes.set_title("for an emitter that starts here")
    axes.set_xlabel(chart.labels[0])
    axes.set_ylabel(chart.labels[1])
    axes.set_xlim(chart.across[0], chart.across[-1])
    axes.set_ylim(chart.along[0], chart.along[-1])
    if not chart.globe:
        axes.set_aspect("equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)


def _draw_bound(axes: Axes, survey: Survey, chart: _Map) -> None:
    """The bound in colours, its bar in kilometres."""
    bound = survey.bound_elsewhere(chart.positions).reshape(_CELLS, _CELLS) / 1e3
    high = float(bound.max())
    low = max(float(bound.min()), _FLOOR * high)
    label, ticks = "bound on the position at the end, km", _ticks(low, high)
    if high < _FLAT * low:
        label, ticks = f"{label}: nearly constant", FixedLocator([high])
        low, high = low / _FLAT, high * _FLAT
    colours = axes.pcolormesh(
        chart.across, chart.along, bound, norm=LogNorm(low, high), cmap="cividis", shading="nearest"
    )
    bar = axes.figure.colorbar(colours, ax=axes, label=label, ticks=ticks, format=lambda value, _: f"{value:.4g}")
    bar.ax.yaxis.set_minor_locator(NullLocator())


def _ticks(low: float, high: float) -> Locator:
    return LogLocator(subs=(1.0, 2.0, 5.0)) if high > _FEW * low else MaxNLocator(5)


def _draw_platform(axes: Axes, survey: Survey, chart: _Map, index: int) -> None:
    """Where a platform went, its number at the start when there are several, and where it listens."""
    flown = chart.project(np.concatenate([poses[index].position for poses in survey.path], axis=1))
    begin = float(flown[0, 0]), float(flown[1, 0])
    colour, line = _PLATFORMS[index % len(_PLATFORMS)]
    several = len(survey.scenario.platforms) > 1
    label = f"platform {index}" if several else "observer"
    inside = (flown[0] - chart.across[0]) * (flown[0] - chart.across[-1]) <= 0.0
    inside &= (flown[1] - chart.along[0]) * (flown[1] - chart.along[-1]) <= 0.0
    axes.plot(*flown, color="white", lw=4.0)
    axes.plot(*flown, line, color=colour, lw=2.0, label=label if inside.any() else f"{label} (outside the map)")
    axes.plot(*begin, "o", color=colour, mec="white", ms=12 if several else 8, zorder=3)
    if several and inside[0]:
        axes.text(*begin, f"{index}", color="white", size=8, ha="center", va="center_baseline", zorder=4)
    name: str | None = "lever arm at start and end"
    arms = [arm for sensor in survey.simulation.realised.sensors for place, arm in sensor.places if place == index]
    for arm in filter(None, arms):
        for pose in (survey.path[0][index], survey.path[-1][index]):
            ends = np.concatenate([pose.position, pose.mounted(arm).position], axis=1)
            axes.plot(*chart.project(ends), "s-", color="white", mec=colour, ms=5, label=name)
            name = None


def _draw_emitter(axes: Axes, survey: Survey, chart: _Map) -> None:
    """Where the emitter went, and how near one may come to it."""
    start = survey.start[survey.layout.position]
    emitter = chart.project(np.concatenate([start, survey.states[:, survey.layout.position].T], axis=1))
    axes.plot(*emitter, color="white", lw=4.0)
    axes.plot(*emitter, color=EMITTER, lw=2.0, label="emitter of this episode")
    axes.plot(*emitter[:, :1], "o", color=EMITTER, mec="white", ms=8, zorder=3)
    keep_out = survey.scenario.episode.min_range / 1e3
    if keep_out and not chart.globe:
        centre = (float(emitter[0, -1]), float(emitter[1, -1]))
        label = "minimum range at the end"
        axes.add_patch(CirclePatch(centre, keep_out, fill=False, ls=":", lw=1.5, color=EMITTER, label=label))


def _draw_time(axes: Axes, survey: Survey) -> None:
    axes.semilogy(survey.time, survey.position_bound, color=BOUND, lw=2.0, label="bound on the position")
    own = survey.scenario.own_ship
    label = "range" if len(survey.scenario.platforms) == 1 else f"range of platform {own}"
    axes.semilogy(survey.time, survey.range, color=_PLATFORMS[own % len(_PLATFORMS)][0], lw=1.5, ls="--", label=label)
    axes.set_xlabel("time, s")
    axes.set_ylabel("range and bound on the position, m")
    axes.set_title("for the emitter of this episode")
    axes.grid(alpha=0.3, which="both")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)
