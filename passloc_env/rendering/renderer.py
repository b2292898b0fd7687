"""Pictures of running environments, as arrays or in a window."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from gymnasium.error import DependencyNotInstalled

from passloc_env.batch import Batch
from passloc_env.crew import CrewBatch
from passloc_env.errors import unknown_name
from passloc_env.rendering.canvas import Canvas, pygame
from passloc_env.rendering.frame import SIZE, draw_frame
from passloc_env.rendering.record import Recorder
from passloc_env.rendering.window import Window

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
        shown = 1 if mode == "human" else min(batch.tiles[0].environments, _SHOWN)
        self._recorders = [Recorder(batch.tiles[0], column) for column in range(shown)]
        try:
            pygame()
        except ModuleNotFoundError:
            raise DependencyNotInstalled("rendering needs pygame-ce: pip install 'passloc[render]'") from None
        self._window: Window | None = None
        if mode == "human":
            self._window = Window(batch.scenario.name, SIZE, SIZE, "use render_mode='rgb_array'")

    def frames(self) -> tuple[np.ndarray, ...]:
        """A picture ``(600, 600, 3)`` uint8 of each environment that is shown."""
        return tuple(canvas.pixels() for canvas in self._canvases())

    def show(self) -> None:
        """Bring the first environment to the window, if there is one, at its time."""
        if self._window is not None:
            self._window.show(next(self._canvases()).pixels(), FRAMES_PER_SECOND)

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _canvases(self) -> Iterator[Canvas]:
        for recorder in self._recorders:
            yield draw_frame(self._scenario, recorder.look())
