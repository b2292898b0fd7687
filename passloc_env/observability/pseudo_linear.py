"""Pseudo-linear rows of bearing and Doppler: linear in the state, with the measured bearings as coefficients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array
from passloc_env.checks import as_floats, require_count, require_exactly, require_positive, require_shape
from passloc_env.errors import InputError
from passloc_env.layout import StateLayout


def pseudo_linear_rows(bearing: ArrayLike, layout: StateLayout, doppler: bool = False) -> Array:
    """Rows of the pseudo-linear measurement at given bearings, planar problems.

    ``0 = cos θ · x − sin θ · y`` relative to the observer, and with Doppler
    ``−(f − f₀) c / f₀ = sin θ · v_x + cos θ · v_y`` (paper 000, eqs. 12–13).

    Args:
        bearing: ``(K, N)``, rad.
        layout: rows of the state.
        doppler: whether the second row is there too.

    Returns:
        ``(K, 1 or 2, n, N)``; the bearing row in metres per metre, the Doppler row in m/s per m/s.

    Raises:
        InputError: bearings that are not finite or have another shape, a layout that is not planar.
    """
    record = require_shape("bearing", bearing, 2, "instants and environments")
    _require_planar(layout)
    steps, batch = record.shape
    sine, cosine = np.sin(record), np.cos(record)
    rows = np.zeros((steps, 2 if doppler else 1, layout.size, batch))
    rows[:, 0, layout.position] = np.stack([cosine, -sine], axis=1)
    if doppler:
        rows[:, 1, layout.velocity] = np.stack([sine, cosine], axis=1)
    return rows


def _require_planar(layout: StateLayout) -> None:
    if layout.dimension != 2:
        raise InputError(f"layout of {layout.dimension} axes is not possible: must be planar")


def augmented_layout(layout: StateLayout) -> StateLayout:
    """The layout of the augmented state: the last row is the constant."""
    return layout.with_nuisance(("constant",))


def augmented_transition(transition: ArrayLike) -> Array:
    """``Φ`` with a last state that stays what it is, ``(n, n)`` or ``(n, n, 1|N)`` to ``(n + 1, n + 1, 1|N)``.

    Raises:
        InputError: another shape, numbers that are not finite.
    """
    given = as_floats("transition", transition)
    step = require_shape("transition", given[..., None] if given.ndim == 2 else given, 3, "(n, n) or (n, n, 1|N)")
    n = len(step)
    require_exactly("transition", step, (n, n, step.shape[2]))
    augmented = np.zeros((n + 1, n + 1, step.shape[-1]))
    augmented[:n, :n] = step
    augmented[n, n] = 1.0
    return augmented


def augmented_pseudo_linear_rows(
    bearings: ArrayLike,
    stations: ArrayLike,
    layout: StateLayout,
    *,
    propagation_speed: float,
    duration: float,
    frequency_stations: Sequence[int] = (0,),
) -> Array:
    """Rows for fixed stations that hear bearing and frequency, with all known terms carried by a constant state.

    A station at ``(X, Y)`` knows ``0 = cos θ (x − X) − sin θ (y − Y)``, and one that hears the carrier
    ``f c/f₀ = c − sin θ v_x − cos θ v_y``. What does not multiply the state multiplies a last state that is constant:
    one station at the origin gives the five columns of paper 000, eq. 14, two stations and an acceleration the seven of
    paper 003, sec. 2.1. A known acceleration drops out of the rows.

    All rows and columns are speeds, so that ranks and conditions compare like with like. The constant is the
    propagation speed c itself, in m/s: it enters the frequency row with 1 and the bearing row of a station with the
    time sound or light takes to it. Bearing rows are divided by the length of the record; together with
    :func:`~passloc_env.observability.record_scale`, time is counted in records.

    The bearing rows alone are homogeneous: they never tell the true state and constant from a multiple of both.

    Args:
        bearings: ``(K, S, N)`` by instant and station, rad.
        stations: east and north of each station ``(S, 2)``, m.
        layout: rows of the planar state, without the constant.
        propagation_speed: c, m/s.
        duration: length of the record, s.
        frequency_stations: which stations hear the carrier, none or several.

    Returns:
        ``(K, S + F, n + 1, N)``: the bearing rows by station, then the frequency rows of F stations, for the state of
        :func:`augmented_layout`.

    Raises:
        InputError: shapes that do not match, a station that does not exist, bearings or stations that are not finite, a
            speed or duration that is not finite and positive, a layout that is not planar.
    """
    record, places = _checked_stations(bearings, stations, frequency_stations)
    _require_planar(layout)
    require_positive("propagation_speed", propagation_speed)
    require_positive("duration", duration)
    instants, count, batch = record.shape
    heard = list(frequency_stations)
    sine, cosine = np.sin(record), np.cos(record)
    east, north = places[:, 0, None], places[:, 1, None]

    rows = np.zeros((instants, count + len(heard), layout.size + 1, batch))
    constant = layout.size
    rows[:, :count, layout.position] = np.stack([cosine, -sine], axis=2) / duration
    rows[:, :count, constant] = (sine * north - cosine * east) / (propagation_speed * duration)
    rows[:, count:, layout.velocity] = -np.stack([sine[:, heard], cosine[:, heard]], axis=2)
    rows[:, count:, constant] = 1.0
    return rows


def _checked_stations(
    bearings: ArrayLike, stations: ArrayLike, frequency_stations: Sequence[int]
) -> tuple[Array, Array]:
    """Bearings ``(K, S, N)`` and stations ``(S, 2)``; refuses those that do not belong together."""
    record = require_shape("bearings", bearings, 3, "instants, stations and environments")
    count = record.shape[1]
    places = require_exactly("stations", stations, (count, 2))
    for station in frequency_stations:
        require_count("frequency_stations", station, at_least=0)
        if station >= count:
            raise InputError(f"frequency_stations = {station} is not possible: must be between 0 and {count - 1}")
    return record, places
