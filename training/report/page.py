"""The page itself: one HTML file that holds all it needs."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from training.files import write_whole


@dataclass(frozen=True)
class Chart:
    """A chart with what is said about it.

    Attributes:
        name: its id on the page.
        title, words: its heading, and what it shows.
        figure: Plotly's.
        before: whether it stands before the episode.
    """

    name: str
    title: str
    words: str
    figure: go.Figure
    before: bool = True


@dataclass
class Page:
    """What is on a page; what is empty is left out.

    Attributes:
        title: of the page.
        lead: paragraphs below it.
        table: title, headings, rows, the number of the column that it is sorted by, notes.
        charts: in their order.
        player: what :func:`training.report.player.played` returns.
        configuration: texts by their titles.
        command: what made it all.
    """

    title: str
    lead: list[str] = field(default_factory=list)
    table: dict[str, Any] = field(default_factory=dict)
    charts: list[Chart] = field(default_factory=list)
    player: dict[str, Any] = field(default_factory=dict)
    configuration: dict[str, str] = field(default_factory=dict)
    command: str = ""


def write_report(page: Page, path: Path) -> None:
    """Write a page; the file appears whole or not at all."""
    write_whole(path, html(page))


def html(page: Page) -> str:
    """The page as text; it needs nothing from elsewhere."""
    folder = resources.files("training.report") / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text(encoding="utf-8")),
        autoescape=True,
        trim_blocks=True,
    )
    chart = environment.get_template("chart.html")
    contents = {each.name: getattr(page, each.name) for each in dataclasses.fields(page)}
    return environment.get_template("page.html").render(
        contents
        | {
            "draw": lambda each: Markup(chart.render(chart=each)),
            "figures": {each.name: json.loads(each.figure.to_json()) for each in page.charts},
            "player": _player(page.player) if page.player else None,
            "plotly": get_plotlyjs(),
            "style": (folder / "style.css").read_text(encoding="utf-8"),
            "script": (folder / "script.js").read_text(encoding="utf-8"),
        }
    )


def _player(data: dict[str, Any]) -> dict[str, Any]:
    """What the template says about the episode."""
    colours = data["colours"]
    legend = [("observer", "observer", ""), ("emitter", "emitter", ""), ("estimate with 2σ", "estimate", "")]
    legend += [("bearings", "faint", "")] * data["bearings"]
    legend += [("minimum range", "emitter", "2 4")] * data["keep_out"]
    return {
        "data": data,
        "seed": data["seed"],
        "names": [flight["name"] for flight in data["flights"]],
        "frames": max(len(flight["time"]) for flight in data["flights"]),
        "legend": [{"name": name, "colour": colours[key], "dashes": dashes} for name, key, dashes in legend],
    }
