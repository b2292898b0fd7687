"""The charts of a report, as Plotly figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from passloc_env.arrays import Array
from passloc_env.rendering.colours import BOUND, EMITTER, GRID, INK, OBSERVER, POLICIES
from training.evaluate import Evaluation, Verdict
from training.report.errors import ErrorCurve
from training.score import score_of
from training.statistics import Estimate
from training.table import ranked

_ROW = 30
"""Height of a policy's row, pixels."""


def scores(evaluation: Evaluation) -> go.Figure:
    """What policies are ranked by, with 95 % intervals, best on top."""
    score = score_of(evaluation.scenario)
    figure = _forest(evaluation, [(score.column, score.cell, "circle")])
    figure.update_xaxes(title=score.column)
    return figure


def rates(evaluation: Evaluation) -> go.Figure:
    """Violations and lost tracks, with Wilson's intervals."""
    kinds: list[tuple[str, Callable[[Verdict], Estimate], str]] = [
        ("violations", lambda verdict: verdict.violations.scaled(100.0), "circle"),
        ("lost tracks", lambda verdict: verdict.lost.scaled(100.0), "diamond-open"),
    ]
    figure = _forest(evaluation, kinds)
    figure.update_xaxes(title="share of episodes, %", rangemode="tozero")
    return figure


def _forest(evaluation: Evaluation, kinds: Sequence[tuple[str, Callable[[Verdict], Estimate], str]]) -> go.Figure:
    """A row per policy, the best on top; a mark with its interval per kind of figure."""
    verdicts = ranked(evaluation)[::-1]
    figure = go.Figure()
    for (name, of, symbol), colour in zip(kinds, (OBSERVER, EMITTER), strict=False):
        estimates = [of(verdict) for verdict in verdicts]
        figure.add_scatter(
            name=name,
            mode="markers",
            x=[estimate.value for estimate in estimates],
            y=[verdict.policy for verdict in verdicts],
            marker={"size": 10, "symbol": symbol, "color": colour},
            error_x={
                "type": "data",
                "symmetric": False,
                "array": [estimate.high - estimate.value for estimate in estimates],
                "arrayminus": [estimate.value - estimate.low for estimate in estimates],
                "thickness": 2,
                "width": 5,
            },
            hovertemplate="%{y}: %{x:.3f}<extra></extra>",
        )
    figure.update_layout(showlegend=len(kinds) > 1, height=110 + _ROW * len(verdicts))
    figure.update_yaxes(type="category", automargin=True)
    return _dressed(figure)


def learning(curve: Mapping[str, Array]) -> go.Figure:
    """Return and violations in training, against decisions."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08)
    hover = "%{y:.3f} after %{x:,} decisions, %{customdata:.0f} s<extra></extra>"
    rows = (("mean return", curve["mean_return"], OBSERVER), ("violations, %", 100.0 * curve["violations"], EMITTER))
    for row, (name, values, colour) in enumerate(rows, 1):
        figure.add_scatter(
            row=row,
            col=1,
            name=name,
            x=curve["decisions"].tolist(),
            y=values.tolist(),
            customdata=curve["seconds"].tolist(),
            line={"color": colour, "width": 2},
            hovertemplate=hover,
        )
        figure.update_yaxes(title=name, row=row, col=1)
    figure.update_xaxes(title="decisions", row=2, col=1)
    figure.update_layout(showlegend=False, height=440)
    return _dressed(figure)


def errors(curves: Mapping[str, ErrorCurve]) -> go.Figure:
    """Median error of the estimate over time, with quartiles, and that of a tracker as good as the bound."""
    figure = go.Figure()
    for number, (name, curve) in enumerate(curves.items()):
        colour, time = POLICIES[number % len(POLICIES)], curve.time.tolist()
        band = {"x": time + time[::-1], "y": curve.high.tolist() + curve.low.tolist()[::-1]}
        shade = {"fill": "toself", "fillcolor": colour, "opacity": 0.12, "line": {"width": 0}, "hoverinfo": "skip"}
        figure.add_scatter(**band, **shade, mode="lines", showlegend=False, legendgroup=name)
        own: dict[str, Any] = {"x": time, "legendgroup": name, "mode": "lines"}
        figure.add_scatter(
            **own,
            y=curve.error.tolist(),
            name=name,
            line={"color": colour, "width": 2.5},
            hovertemplate=f"{name}: error %{{y:.3g}} % after %{{x:g}} s<extra></extra>",
        )
        figure.add_scatter(
            **own,
            y=curve.bound.tolist(),
            showlegend=False,
            line={"color": colour, "width": 1.5, "dash": "dash"},
            hovertemplate=f"{name}: as good as the bound %{{y:.3g}} % after %{{x:g}} s<extra></extra>",
        )
    figure.update_xaxes(title="time, s")
    figure.update_yaxes(title="median error over range, %", type="log", dtick="D2", tickformat="~g")
    figure.update_layout(height=460)
    return _dressed(figure)


def _dressed(figure: go.Figure) -> go.Figure:
    """The look that all charts share: white, dark words, room for a phone."""
    figure.update_layout(
        template="none",
        font={"family": "system-ui, sans-serif", "size": 14, "color": INK},
        margin={"l": 56, "r": 12, "t": 12, "b": 52},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0},
        hoverlabel={"bgcolor": "white", "font": {"color": INK}},
        paper_bgcolor="white",
        plot_bgcolor="white",
    )
    figure.update_xaxes(gridcolor=GRID, zerolinecolor=GRID, linecolor=BOUND, automargin=True)
    figure.update_yaxes(gridcolor=GRID, zerolinecolor=GRID, linecolor=BOUND, automargin=True)
    return figure
