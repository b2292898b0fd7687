"""A window on the screen."""

from __future__ import annotations

import os

import numpy as np

from passloc_env.errors import RenderError
from passloc_env.rendering.canvas import pygame

_UNSEEN = ("dummy", "offscreen")
"""What SDL draws on when nobody can see it."""


class Window:
    """A window of so many pixels; ``otherwise`` is what to do without a display.

    Raises:
        RenderError: there is no display.
    """

    def __init__(self, title: str, width: int, height: int, otherwise: str) -> None:
        display = pygame().display
        try:
            display.init()
            driver = display.get_driver()
            # Without a display SDL draws for nobody, unless it has been told to.
            if driver in _UNSEEN and os.environ.get("SDL_VIDEODRIVER") != driver:
                display.quit()
                raise pygame().error(f"SDL offers {driver} only")
            self._surface = display.set_mode((width, height))
        except pygame().error as error:
            raise RenderError(f"there is no display to show on ({error}): {otherwise}") from None
        display.set_caption(title)
        self._clock = pygame().time.Clock()

    def show(self, picture: np.ndarray, per_second: float) -> bool:
        """Show a picture ``(height, width, 3)`` when it is its time; False when somebody has closed the window."""
        pygame().surfarray.blit_array(self._surface, picture.swapaxes(0, 1))
        pygame().display.flip()
        self._clock.tick(per_second)
        return self._open()

    def wait(self) -> None:
        """Keep it until somebody closes it."""
        while self._open():
            pygame().time.wait(50)
        self.close()

    def close(self) -> None:
        """Take it away."""
        pygame().display.quit()

    def _open(self) -> bool:
        return all(event.type != pygame().QUIT for event in pygame().event.get())
