"""Okabe and Ito's colours, which colour-blind eyes tell apart; the same in every picture of the project."""

from __future__ import annotations

BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, GREY, BLACK = "#E69F00", "#56B4E9", "#595959", "#000000"

EMITTER, OBSERVER, ESTIMATE, BOUND = VERMILION, BLUE, GREEN, "#555555"
PAPER, INK, FAINT, GRID = "#FFFFFF", "#222222", "#B8B8B8", "#E6E6E6"

POLICIES = (BLUE, VERMILION, GREEN, "#AA3377", BOUND)
"""Where policies are told apart, in their order; all of them dark enough on white."""
