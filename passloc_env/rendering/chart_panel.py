"""The chart: the error of the estimate and the bound on the range, over time."""

from __future__ import annotations

import math

import numpy as np

from passloc_env.rendering.canvas import Canvas
from passloc_env.rendering.colours import BOUND, ESTIMATE, FAINT, GRID
from passloc_env.rendering.record import Instant
from passloc_env.rendering.viewport import round_down

_DECADES = (-1, 2)
"""From 0.1 % to 100 %; what is better or worse is drawn on the edge."""


def draw_chart(canvas: Canvas, instants: list[Instant], duration: float, box: tuple[int, int, int, int]) -> None:
    """Draw an episode of so many seconds up to now into ``(left, top, width, height)``, numbers and names outside."""
    left, top, width, height = box
    low, high = _DECADES

    def across(time: float) -> float:
        return left + width * time / duration

    def up(percent: float) -> float:
        decade = math.log10(percent) if percent > 0.0 else low
        return top + height * (high - min(max(decade, low), high)) / (high - low)

    for decade in range(low, high + 1):
        level = up(10.0**decade)
        canvas.line(np.array([[left, level], [left + width, level]]), GRID)
        canvas.words(f"{10.0**decade:g}", (left - 6, level), size=12, align="right")
    step = round_down(0.25 * duration)
    for time in np.arange(0.0, duration + 1e-9, step).tolist():
        canvas.line(np.array([[across(time), top], [across(time), top + height]]), GRID)
        canvas.words(f"{time:g}", (across(time), top + height + 10), size=12, align="middle")
    canvas.words("time, s", (left + 0.5 * width, top + height + 25), size=13, align="middle")
    canvas.words("of range, %", (left - 36, top + 0.5 * height), size=13, upwards=True)

    canvas.within(*box)
    times = [across(instant.time) for instant in instants]
    bound, error = ([up(100.0 * getattr(each, name)) for each in instants] for name in ("bound", "error"))
    canvas.dashes(np.array([times, bound]).T, BOUND, 2)
    canvas.line(np.array([times, error]).T, ESTIMATE, 2)
    canvas.everywhere()
    canvas.rectangle(*box, FAINT)
