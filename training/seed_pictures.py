"""Learning curves of several training runs, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from passloc_env.arrays import Array
from passloc_env.rendering.colours import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Okabe and Ito's, told apart by colour-blind eyes; further runs begin anew with dashes."""


def draw_curves(curves: Mapping[str, Mapping[str, Array]], title: str, path: Path) -> None:
    """Return and violations in training, against decisions and against wall time.

    Args:
        curves: learning curves as :func:`training.curve.read_curve` returns them, by the name of their run.
        title: of the picture.
        path: a PNG file.
    """
    figure = curves_figure(curves, title)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def curves_figure(curves: Mapping[str, Mapping[str, Array]], title: str) -> Figure:
    """The picture of :func:`draw_curves`, two rows of two axes."""
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 6.4), sharex="col", sharey="row", layout="constrained")
    for index, (name, curve) in enumerate(curves.items()):
        style = {"color": COLOURS[index % len(COLOURS)], "ls": "-" if index < len(COLOURS) else "--", "lw": 1.3}
        for column, time in enumerate((curve["decisions"] / 1e6, curve["seconds"] / 60.0)):
            axes[0, column].plot(time, curve["mean_return"], label=name, **style)
            axes[1, column].plot(time, 100.0 * curve["violations"], label=name, **style)
    axes[0, 0].set_ylabel("mean return per episode")
    axes[1, 0].set_ylabel("violations in training, %")
    axes[1, 0].set_ylim(bottom=0.0)
    axes[1, 0].set_xlabel("decisions, millions")
    axes[1, 1].set_xlabel("wall time, min")
    for one in axes.flat:
        one.grid(alpha=0.3)
    axes[0, 1].legend(loc="lower right")
    figure.suptitle(title)
    return figure
