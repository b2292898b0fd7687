"""Pictures that move: GIF and MP4 files from frames."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image

from training.files import appearing

_COLOURS = 64
"""Of a GIF's palette: what is drawn has ten, and the shades between them."""


def write_gif(path: Path, frames: Iterable[np.ndarray], per_second: float) -> None:
    """Write frames ``(height, width, 3)``; a file appears when it is whole.

    All share the palette of the last one, which has seen everything: what stays as it was then costs nothing.
    """
    pictures = [Image.fromarray(frame) for frame in frames]
    palette = pictures[-1].quantize(_COLOURS, dither=Image.Dither.NONE)
    first, *others = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    with appearing(path) as part:
        first.save(part, "GIF", save_all=True, append_images=others, duration=round(1e3 / per_second), loop=0)


def write_mp4(path: Path, frames: Iterable[np.ndarray], per_second: float) -> None:
    """Write frames ``(height, width, 3)`` of even sizes; a file appears when it is whole."""
    first, *others = frames
    height, width = first.shape[:2]
    with appearing(path) as part:
        writer = imageio_ffmpeg.write_frames(str(part), (width, height), fps=per_second, macro_block_size=2)
        with contextlib.closing(writer):
            writer.send(None)
            for frame in (first, *others):
                writer.send(np.ascontiguousarray(frame))
