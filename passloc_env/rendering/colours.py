"""Okabe and Ito's colours, which colour-blind eyes tell apart; the same in every picture of the project."""

from __future__ import annotations

EMITTER, OBSERVER, ESTIMATE, BOUND = "#D55E00", "#0072B2", "#009E73", "#555555"
PAPER, INK, FAINT, GRID = "#FFFFFF", "#222222", "#B8B8B8", "#E6E6E6"

POLICIES = ("#0072B2", "#D55E00", "#009E73", "#AA3377", "#555555")
"""Where policies are told apart, in their order; all of them dark enough on white."""
