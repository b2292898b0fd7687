"""A flight as tidy tables: one row per instant and thing, one column per quantity, its unit in the column's name."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from passloc_env.angles import bearing_of
from passloc_env.arrays import Array
from passloc_env.component import specs
from passloc_env.errors import unknown_name
from passloc_env.layout import StateLayout
from passloc_env.platforms import Pose
from passloc_env.sensors import Sensor
from training.export.flight import Flight
from training.files import write_whole

Table = dict[str, np.ndarray]
"""Columns by name, all of one length."""

_BODY_AXES = ("forward", "starboard", "down")


def tables(flight: Flight) -> dict[str, Table]:
    """The tables ``truth``, ``platforms``, ``detections`` and ``tracks`` of a flight."""
    return {
        "truth": {**_instants(flight), **_named(flight.truth, flight.truth_layout, flight.truth_units)},
        "platforms": _stacked(_platform(flight, index) for index in range(len(flight.poses))),
        "detections": _by_time(_stacked(_scalars(flight))),
        "tracks": _tracks(flight),
    }


def write_tables(flight: Flight, folder: Path, form: str) -> list[Path]:
    """Write each table into a folder that exists; a file there is replaced, and appears whole or not at all.

    Args:
        flight: what to write.
        folder: where to.
        form: ``csv``, or ``parquet``, which needs pyarrow.

    Returns:
        The files written.

    Raises:
        ScenarioError: an unknown form.
    """
    encode = encoder(form)
    contents = {folder / f"{name}.{form}": encode(table) for name, table in tables(flight).items()}
    for path, content in contents.items():
        write_whole(path, content)
    return list(contents)


def encoder(form: str) -> Callable[[Table], str | bytes]:
    """What turns a table into the content of a file.

    Raises:
        ScenarioError: an unknown form.
        ModuleNotFoundError: Parquet without pyarrow.
    """
    if form == "csv":
        return _csv
    if form == "parquet":
        return _parquet()
    raise unknown_name("format", form, ("csv", "parquet"), "format")


def _csv(table: Table) -> str:
    """Numbers in the fewest digits that give them back to the last bit; nothing where nothing is known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(map(_word, values.tolist()) for values in table.values()), strict=True))
    return text.getvalue()


def _word(value: object) -> object:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value != value else value


def _parquet() -> Callable[[Table], bytes]:
    """Null where nothing is known."""
    import pyarrow
    from pyarrow import parquet

    def encode(table: Table) -> bytes:
        content = io.BytesIO()
        columns = {name: pyarrow.array(values, from_pandas=True) for name, values in table.items()}
        parquet.write_table(pyarrow.table(columns), content)
        return content.getvalue()

    return encode


def _instants(flight: Flight) -> Table:
    """The columns that every table begins with."""
    return {"seed": np.full(len(flight.time), flight.seed), "time_s": flight.time}


def _named(state: Array, layout: StateLayout, units: tuple[str, ...]) -> Table:
    return dict(zip(_columns(layout, units), state, strict=True))


def _columns(layout: StateLayout, units: tuple[str, ...]) -> list[str]:
    """Such as ``east_m`` and ``north_velocity_m_per_s``."""
    return [_column(name, unit) for name, unit in zip(layout.names, units, strict=True)]


def _column(name: str, unit: str) -> str:
    return f"{name} {unit}".strip().replace("/", "_per_").replace("²", "2").replace(" ", "_")


def _platform(flight: Flight, index: int) -> Table:
    """Where one platform was, and where it reported to be."""
    true, reported = flight.poses[index], flight.reported[index]
    kind = type(flight.scenario.platforms[index]).__name__
    return {
        **_instants(flight),
        "platform": np.full(len(flight.time), index),
        "kind": np.full(len(flight.time), kind),
        **_posed(true),
        **{f"reported_{name}": values for name, values in _posed(reported).items()},
    }


def _posed(pose: Pose) -> Table:
    """Position, velocity, and in the plane the heading of the body, in space its axes."""
    layout = StateLayout(len(pose.position))
    named = _named(np.concatenate([pose.position, pose.velocity]), layout, layout.units({}))
    if layout.dimension == 2:
        return {**named, "heading_rad": bearing_of(pose.attitude[0])}
    axes = layout.names[layout.position]
    bodies = zip(_BODY_AXES, pose.attitude, strict=True)
    return {**named, **{f"{body}_{axis}": part for body, row in bodies for axis, part in zip(axes, row, strict=True)}}


def _scalars(flight: Flight) -> Iterable[Table]:
    """Each scalar of each sensor; no value where it was not detected."""
    for index, (sensor, rows) in enumerate(zip(flight.suite.sensors, flight.suite.rows, strict=True)):
        for component, row in enumerate(range(rows.start, rows.stop)):
            constant = {
                "sensor": index,
                "kind": type(sensor).__name__,
                "platform": sensor.platform,
                "component": component,
                "unit": _unit(sensor),
            }
            yield {
                **_instants(flight),
                **{name: np.full(len(flight.time), value) for name, value in constant.items()},
                "detected": flight.detected[row],
                "value": flight.measurement[row],
            }


def _unit(sensor: Sensor) -> str:
    """That of a measurement, which its standard deviation is given in."""
    spec = specs(type(sensor)).get("sigma")
    return "" if spec is None else spec.unit


def _tracks(flight: Flight) -> Table:
    columns = _columns(flight.track_layout, flight.track_units)
    pairs = combinations_with_replacement(range(len(columns)), 2)
    return {
        **_instants(flight),
        **dict(zip(columns, flight.mean, strict=True)),
        **{f"covariance_{columns[row]}_{columns[column]}": flight.covariance[row, column] for row, column in pairs},
        "range_m": flight.range,
        "relative_range_error": flight.relative_range_error,
        "range_bound_m": flight.range_bound,
        "nees": flight.nees,
    }


def _stacked(parts: Iterable[Table]) -> Table:
    """Tables of the same columns under each other."""
    parts = list(parts)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _by_time(table: Table) -> Table:
    order = np.argsort(table["time_s"], kind="stable")
    return {name: values[order] for name, values in table.items()}
