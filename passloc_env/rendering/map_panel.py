"""The map: who flew where, what was heard, what is believed."""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array
from passloc_env.rendering.canvas import Canvas
from passloc_env.rendering.colours import EMITTER, ESTIMATE, FAINT, GRID, INK, OBSERVER
from passloc_env.rendering.record import Instant
from passloc_env.rendering.viewport import Viewport, in_words

_HEARD = 5
"""Bearings shown, the latest ones."""

_SIGMAS = 2.0
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)
_CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


def extent(instants: list[Instant], min_range: float) -> Array:
    """Points ``(k, 2)`` that a map must show so that nobody leaves it in all of these instants, m."""
    emitters = np.array([instant.emitter for instant in instants])
    observers = np.concatenate([instant.platforms for instant in instants])
    return np.concatenate([observers, emitters - min_range, emitters + min_range])


def draw_map(
    canvas: Canvas,
    instants: list[Instant],
    min_range: float,
    box: tuple[int, int, int, int],
    shown: Array | None = None,
) -> None:
    """Draw an episode up to now into ``(left, top, width, height)``.

    What is shown are the given points ``(k, 2)``, m, and what is beside them; by default all there is to see now.
    """
    now = instants[-1]
    platforms = np.array([instant.platforms for instant in instants])
    emitter, estimate = (np.array([getattr(instant, name) for instant in instants]) for name in ("emitter", "estimate"))
    ring = now.emitter + min_range * _CIRCLE
    belief = ellipse(now)
    if shown is None:
        shown = np.concatenate([platforms.reshape(-1, 2), emitter, ring, belief])
    view = Viewport.around(shown, *box)
    canvas.within(*box)
    _grid(canvas, view)
    _bearings(canvas, view, instants[-_HEARD:])
    if min_range:
        canvas.dashes(view.pixels(ring), EMITTER, dash=3.0, gap=4.0)
    canvas.line(view.pixels(estimate), ESTIMATE)
    canvas.line(view.pixels(belief), ESTIMATE, 2)
    canvas.line(view.pixels(emitter), EMITTER, 3)
    for track in platforms.swapaxes(0, 1):
        canvas.line(view.pixels(track), OBSERVER, 3)
        canvas.dot(view.pixels(track[-1]), 6, OBSERVER)
    canvas.dot(view.pixels(now.emitter), 6, EMITTER)
    canvas.dot(view.pixels(now.estimate), 6, ESTIMATE, hollow=True)
    canvas.everywhere()
    canvas.rectangle(*box, FAINT)
    _scale_bar(canvas, view)


def ellipse(instant: Instant) -> Array:
    """The outline ``(k, 2)`` of a belief at two standard deviations, m."""
    if not np.isfinite(instant.covariance).all():
        return np.full((1, 2), np.nan)
    values, vectors = np.linalg.eigh(0.5 * (instant.covariance + instant.covariance.T))
    axes = vectors * (_SIGMAS * np.sqrt(np.maximum(values, 0.0)))
    outline: Array = instant.estimate + _CIRCLE @ axes.T
    return outline


def _grid(canvas: Canvas, view: Viewport) -> None:
    """Lines one scale bar apart."""
    half = 0.5 * view.scale * np.array([view.width, view.height])
    for axis in (0, 1):
        first, last = np.ceil((view.centre[axis] - half[axis]) / view.bar), (view.centre[axis] + half[axis]) / view.bar
        for value in np.arange(first, last) * view.bar:
            ends = np.array([view.centre - half, view.centre + half])
            ends[:, axis] = value
            canvas.line(view.pixels(ends), GRID)


def _bearings(canvas: Canvas, view: Viewport, instants: list[Instant]) -> None:
    """Lines of bearing, as far as the map goes."""
    reach = view.scale * (view.width + view.height)
    for instant in instants:
        for origin, bearing in instant.bearings:
            towards = origin + reach * np.array([np.sin(bearing), np.cos(bearing)])
            canvas.line(view.pixels(np.array([origin, towards])), FAINT)


def _scale_bar(canvas: Canvas, view: Viewport) -> None:
    right, bottom = view.left + view.width - 14, view.top + view.height - 14
    left = right - round(view.bar / view.scale)
    canvas.line(np.array([[left, bottom], [right, bottom]], float), INK, 2)
    for end in (left, right):
        canvas.line(np.array([[end, bottom - 4], [end, bottom + 4]], float), INK, 2)
    canvas.words(in_words(view.bar), (0.5 * (left + right), bottom - 12), align="middle")
    north = np.array([[view.left + 18, view.top + 34], [view.left + 18, view.top + 12]], float)
    canvas.line(north, INK, 2)
    canvas.line(north[1] + np.array([[-4, 7], [0, 0], [4, 7]]), INK, 2)
    canvas.words("N", (view.left + 18, view.top + 44), align="middle")
