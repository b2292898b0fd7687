"""Measurement Jacobians in torch, one small function per sensor, so that gradients flow back into the path.

The formulas are those of :mod:`passloc_env.sensors`; tests hold both together. Each function returns only the leading
rows of the state that its sensor depends on, for the recursion skips the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from passloc_env.errors import ScenarioError
from passloc_env.faults import SOUND
from passloc_env.layout import StateLayout
from passloc_env.sensors import Bearing, Doppler, Sensor


@dataclass
class Look:
    """The true emitter seen from the observer at many instants.

    Attributes:
        offset, velocity: of the emitter relative to the observer ``(2, K, B)``.
        forward: the observer's axis ``(2, K, B)``.
        state: true state of the emitter ``(n, K, B)``.
        layout: its rows.
    """

    offset: Tensor
    velocity: Tensor
    forward: Tensor
    state: Tensor
    layout: StateLayout


def bearing(sensor: Bearing, look: Look) -> Tensor:
    """``(cos θ, −sin θ)/ρ``, the two position rows ``(2, K, B)``."""
    offset = look.offset
    if sensor.lever_arm:
        ahead, starboard = (_number(arm) for arm in sensor.lever_arm)
        side = torch.stack([look.forward[1], -look.forward[0]])
        offset = offset - ahead * look.forward - starboard * side
    square = (offset * offset).sum(0)
    return torch.stack([offset[1] / square, -offset[0] / square])


def doppler(sensor: Doppler, look: Look) -> Tensor:
    """``−f/c (v_⊥/r, u)`` and ``1 − ṙ/c`` for an unknown carrier's offset, ``(4 … n, K, B)``."""
    distance = (look.offset * look.offset).sum(0).sqrt()
    towards = look.offset / distance
    rate = (towards * look.velocity).sum(0)
    speed, carrier = _number(sensor.propagation_speed), _number(sensor.carrier)
    if not sensor.unknown_carrier:
        scale = -carrier / speed
        return torch.cat([scale / distance * (look.velocity - rate * towards), scale * towards])
    row = look.layout.nuisance_row("carrier_offset")
    scale = -(carrier + look.state[row]) / speed
    known = [scale / distance * (look.velocity - rate * towards), scale * towards]
    between = torch.zeros((row - look.layout.velocity.stop, *distance.shape), dtype=distance.dtype)
    return torch.cat([*known, between, (1.0 - rate / speed)[None]])


_JACOBIANS: dict[type[Sensor], Callable[[Any, Look], Tensor]] = {Bearing: bearing, Doppler: doppler}


def jacobians(sensors: Sequence[Sensor], look: Look) -> list[Tensor]:
    """The derivative of every sensor's scalar with respect to the leading rows of the state ``(w, K, B)``."""
    return [_JACOBIANS[type(sensor)](sensor, look) for sensor in sensors]


def check_sensors(sensors: Sequence[Sensor]) -> None:
    """Raise ScenarioError, in one line, for sensors that have no function here or that sometimes hear nothing."""
    for index, sensor in enumerate(sensors):
        if type(sensor) not in _JACOBIANS:
            known = ", ".join(kind.__name__ for kind in _JACOBIANS)
            allowed = f"the trajectory optimum knows {known}"
            raise ScenarioError(f"sensors.{index}", type(sensor).__name__, allowed)
        if sensor.faults != SOUND:
            allowed = "the trajectory optimum needs sensors with which nothing goes wrong"
            raise ScenarioError(f"sensors.{index}.faults", sensor.faults, allowed)
        if sensor.detection_probability != 1.0:
            allowed = "the trajectory optimum needs sensors that never miss"
            raise ScenarioError(f"sensors.{index}.detection_probability", sensor.detection_probability, allowed)
        if sensor.lever_arm and not isinstance(sensor, Bearing):
            allowed = "the trajectory optimum knows lever arms of bearings only"
            raise ScenarioError(f"sensors.{index}.lever_arm", sensor.lever_arm, allowed)


def _number(value: Any) -> Any:
    """A realised quantity as torch meets it: a float, or a tensor ``(B,)``."""
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value
