"""Pictures of running environments, as arrays or in a window."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from passloc_env.batch import Batch
from passloc_env.crew import CrewBatch
from passloc_env.errors import RenderError, unknown_name
from passloc_env.rendering.canvas import Canvas, pygame
from passloc_env.rendering.frame import SIZE, draw_frame
from passloc_env.rendering.record import Recorder

RENDER_MODES = ("human", "rgb_array")
FRAMES_PER_SECOND = 10
"""Decisions shown in a second."""

_SHOWN = 16
"""Environments of a batch that are shown at most: the first ones."""


class Renderer:
    """Shows the first environments of a batch.

    Args:
        batch: the environments, in this process.
        mode: ``rgb_array`` for arrays, ``human`` for a window with the first environment.

    Raises:
        ValueError: an unknown mode, or environments in other processes.
        DependencyNotInstalled: pygame is missing.
        RenderError: there is no display for a window.
    """

    def __init__(self, batch: Batch | CrewBatch, mode: str) -> None:
        if mode not in RENDER_MODES:
            raise unknown_name("render_mode", mode, list(RENDER_MODES), "render mode")
        if isinstance(batch, CrewBatch):
            raise ValueError("worlds in other processes cannot be shown: build the environment with workers=1")
        self._scenario = batch.scenario
        shown = min(batch.tiles[0].environments, _SHOWN)
        self._recorders = [Recorder(batch.tiles[0], column) for column in range(shown)]
        self._window: Any = None
        if pygame() and mode == "human":
            self._window, self._clock = _open_window(batch.scenario.name), pygame().time.Clock()

    def frames(self) -> tuple[np.ndarray, ...]:
        """A picture ``(600, 600, 3)`` uint8 of each environment that is shown."""
        return tuple(canvas.pixels() for canvas in self._canvases())

    def show(self) -> None:
        """Bring the first environment to the window, at its time."""
        canvas = next(self._canvases())
        self._window.blit(canvas.surface, (0, 0))
        pygame().event.pump()
        pygame().display.flip()
        self._clock.tick(FRAMES_PER_SECOND)

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            pygame().display.quit()
            self._window = None

    def _canvases(self) -> Iterator[Canvas]:
        for recorder in self._recorders:
            yield draw_frame(self._scenario, recorder.look())


def _open_window(title: str) -> Any:
    """A window of a picture's size; RenderError where there is no display."""
    display = pygame().display
    try:
        display.init()
        window = display.set_mode((SIZE, SIZE))
    except pygame().error as error:
        raise RenderError(f"there is no display to show on ({error}): use render_mode='rgb_array'") from None
    display.set_caption(title)
    return window
