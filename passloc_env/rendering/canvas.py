"""Lines, circles and words on a pygame surface, in pixels."""

from __future__ import annotations

import os
from functools import cache
from typing import Any, Literal

import numpy as np

from passloc_env.arrays import Array
from passloc_env.rendering.colours import INK, PAPER

_FAR = 20_000.0
"""Nothing is drawn further out, pixels: pygame knows small whole numbers only."""


@cache
def pygame() -> Any:
    """The library; ModuleNotFoundError where it is missing."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame

    pygame.font.init()
    return pygame


class Canvas:
    """A picture of so many pixels."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.surface = pygame().Surface((width, height))
        self.surface.fill(PAPER)

    def within(self, left: int, top: int, width: int, height: int) -> None:
        """Draw in a part of the picture only."""
        self.surface.set_clip((left, top, width, height))

    def everywhere(self) -> None:
        """Draw anywhere again."""
        self.surface.set_clip(None)

    def line(self, points: Array, colour: str, width: int = 1) -> None:
        """A line through points ``(k, 2)``; what is no number breaks it."""
        whole = np.isfinite(points).all(axis=1)
        pieces = np.split(np.clip(points, -_FAR, _FAR), np.flatnonzero(~whole))
        for piece in pieces:
            kept = piece[np.isfinite(piece).all(axis=1)]
            if len(kept) > 1:
                self._strokes(kept, colour, width)

    def dashes(self, points: Array, colour: str, width: int = 1, dash: float = 6.0, gap: float = 5.0) -> None:
        """A dashed line through points ``(k, 2)``."""
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            return
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        for start in np.arange(0.0, min(lengths[-1], _FAR), dash + gap):
            along = np.linspace(start, min(start + dash, lengths[-1]), 3)
            self._strokes(np.stack([np.interp(along, lengths, axis) for axis in points.T], axis=1), colour, width)

    def _strokes(self, points: Array, colour: str, width: int) -> None:
        draw = pygame().draw
        draw.aalines(self.surface, colour, False, points.tolist())
        if width > 1:
            draw.lines(self.surface, colour, False, points.tolist(), width)

    def dot(self, point: Array, radius: int, colour: str, hollow: bool = False) -> None:
        """A disc, or a ring."""
        if np.isfinite(point).all() and (np.abs(point) < _FAR).all():
            pygame().draw.circle(self.surface, colour, point.tolist(), radius, 2 if hollow else 0)

    def rectangle(self, left: int, top: int, width: int, height: int, colour: str) -> None:
        """The edge of a rectangle."""
        pygame().draw.rect(self.surface, colour, (left, top, width, height), 1)

    def words(
        self,
        text: str,
        place: tuple[float, float],
        size: int = 14,
        colour: str = INK,
        align: Literal["left", "middle", "right"] = "left",
        upwards: bool = False,
    ) -> int:
        """Words, their vertical middle at the place; returns their width in pixels.

        Args:
            text: the words.
            place: where they begin, have their middle, or end.
            size: height of the letters.
            colour: theirs.
            align: what is at the place.
            upwards: whether they run from below to above.
        """
        written = _font(size).render(text, True, colour)
        if upwards:
            written = pygame().transform.rotate(written, 90.0)
        width, height = written.get_size()
        shift = 0.5 * width if upwards else {"left": 0.0, "middle": 0.5, "right": 1.0}[align] * width
        self.surface.blit(written, (round(place[0] - shift), round(place[1] - 0.5 * height)))
        return int(width)

    def pixels(self) -> np.ndarray:
        """The picture ``(height, width, 3)``, uint8."""
        return np.ascontiguousarray(pygame().surfarray.array3d(self.surface).swapaxes(0, 1))


def width_of(text: str, size: int = 14) -> int:
    """How wide words will be, in pixels."""
    return int(_font(size).size(text)[0])


@cache
def _font(size: int) -> Any:
    return pygame().font.Font(None, round(1.35 * size))
