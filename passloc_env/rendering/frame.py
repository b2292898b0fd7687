"""A picture of an episode: heading and legend, the map, the chart."""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array
from passloc_env.rendering.canvas import Canvas, width_of
from passloc_env.rendering.chart_panel import draw_chart
from passloc_env.rendering.colours import BOUND, EMITTER, ESTIMATE, FAINT, INK, OBSERVER
from passloc_env.rendering.map_panel import draw_map
from passloc_env.rendering.record import Instant
from passloc_env.scenario import Scenario

SIZE = 600
"""Width and height, pixels."""

_MAP = (12, 58, SIZE - 24, 372)
_CHART = (62, 446, SIZE - 80, 102)


def draw_frame(
    scenario: Scenario, instants: list[Instant], title: str | None = None, shown: Array | None = None
) -> Canvas:
    """Draw the episode of one environment, which has begun.

    Args:
        scenario: the problem.
        instants: what has happened.
        title: the scenario's name by default.
        shown: points ``(k, 2)`` that the map is to show, m; by default it follows what happens.
    """
    now, episode, canvas = instants[-1], scenario.episode, Canvas(SIZE, SIZE)
    canvas.words(scenario.name if title is None else title, (12, 16), size=17)
    clock = f"{now.time:.0f} of {episode.duration:.0f} s"
    quality = f"error {_percent(now.error)}, bound {_percent(now.bound)}"
    canvas.words(f"{clock} · {quality}", (SIZE - 12, 16), size=14, align="right")
    _legend(canvas, bool(now.bearings), bool(episode.min_range))
    draw_map(canvas, instants, episode.min_range, _MAP, shown)
    draw_chart(canvas, instants, episode.duration, _CHART)
    return canvas


def _legend(canvas: Canvas, bearings: bool, keep_out: bool) -> None:
    """What the colours mean, in one line."""
    entries = [("observer", OBSERVER, "line"), ("emitter", EMITTER, "line"), ("estimate, 2σ", ESTIMATE, "line")]
    entries += [("bearings", FAINT, "line")] * bearings + [("minimum range", EMITTER, "dots")] * keep_out
    entries += [("bound", BOUND, "dashes")]
    room = SIZE - 24 - sum(24 + width_of(name, 13) for name, *_ in entries)
    left = 12.0
    for name, colour, style in entries:
        ends = np.array([[left, 42.0], [left + 18.0, 42.0]])
        if style == "line":
            canvas.line(ends, colour, 3)
        else:
            canvas.dashes(ends, colour, 2, *((3.0, 3.0) if style == "dots" else (7.0, 4.0)))
        left += 24 + canvas.words(name, (left + 24, 42), size=13, colour=INK) + room / max(len(entries) - 1, 1)


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %" if np.isfinite(share) else "unknown"
