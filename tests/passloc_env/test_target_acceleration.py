"""Emitters that start with an acceleration: what the start says, and where it leads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from passloc_env.distributions import Uniform
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, Motion, ReversingAcceleration
from passloc_env.platforms import FixedStation
from passloc_env.scenario import Scenario
from passloc_env.sensors import Doppler
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, PolarStart, Start, Target
from passloc_env.tracking import StatePrior


def in_the_plane(start: Start, motion: Motion) -> Scenario:
    changes: dict[str, Any] = {"target": Target(start=start, motion=motion), "episode.min_range": 0.0}
    return Scenario().override(changes)


def test_a_polar_acceleration_is_along_the_course() -> None:
    rng = np.random.default_rng(0)
    start = replace(PolarStart(range=1.0))
    quantities = {
        "range": rng.uniform(1e3, 1e5, 200),
        "bearing": rng.uniform(-np.pi, np.pi, 200),
        "speed": rng.uniform(0.0, 300.0, 200),
        "course": rng.uniform(-np.pi, np.pi, 200),
        "acceleration": rng.uniform(-3.0, 3.0, 200),
    }
    for name, values in quantities.items():
        object.__setattr__(start, name, values)
    state = start.sample(200)
    towards = np.exp(1j * (np.pi / 2 - start.bearing)), np.exp(1j * (np.pi / 2 - start.course))
    found = state[::2] + 1j * state[1::2]
    expected = np.stack([start.range * towards[0], start.speed * towards[1], start.acceleration * towards[1]])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)  # a few ulp of 100 km


def test_by_hand() -> None:
    """North-east of the origin, eastbound and braking; and by axis, in the plane and in space."""
    polar = PolarStart(range=np.sqrt(2.0) * 1e3, bearing=np.pi / 4, speed=10.0, course=np.pi / 2, acceleration=-0.5)
    np.testing.assert_allclose(polar.sample(1)[:, 0], [1e3, 1e3, 10.0, 0.0, -0.5, 0.0], atol=1e-9)
    flat = CartesianStart(position=(1.0, 2.0), velocity=(3.0, 4.0), acceleration=(5.0, 6.0))
    np.testing.assert_array_equal(flat.sample(3), np.arange(1.0, 7.0)[:, None] * np.ones(3))
    deep = CartesianStart(position=(1.0, 2.0, 3.0), velocity=(4.0, 5.0, 6.0), acceleration=(7.0, 8.0, 9.0))
    np.testing.assert_array_equal(deep.sample(2), np.arange(1.0, 10.0)[:, None] * np.ones(2))
    assert CartesianStart(position=(1.0, 2.0), velocity=(3.0, 4.0)).sample(2).shape == (4, 2)


STARTS = {
    "polar": PolarStart(range=20e3, bearing=1.0, speed=50.0, course=-2.0, acceleration=0.4),
    "by axis": CartesianStart(position=(3e3, 15e3), velocity=(20.0, -10.0), acceleration=(-0.3, 0.2)),
}


@pytest.mark.parametrize("start", STARTS.values(), ids=list(STARTS))
def test_the_emitter_follows_its_acceleration(start: Start, begin: Callable[..., Simulation]) -> None:
    """``p + v t + a t²/2`` after 40 s, to the rounding of 40 steps of some 10⁴ m."""
    state = start.sample(1)
    simulation = begin(in_the_plane(start, ConstantAcceleration()), 2)
    np.testing.assert_array_equal(simulation.truth, state * np.ones(2))
    for _ in range(10):
        simulation.step(np.zeros((1, 2)))
    place, speed, push = state[:2], state[2:4], state[4:]
    expected = np.concatenate([place + 40.0 * speed + 800.0 * push, speed + 40.0 * push, push])
    np.testing.assert_allclose(simulation.truth, expected * np.ones(2), rtol=1e-11)


def test_an_acceleration_reverses(begin: Callable[..., Simulation]) -> None:
    """From rest, 0.2 m/s² for 10.5 s and as much the other way from there; in the middle of a second."""
    start = PolarStart(range=20e3, course=0.5, acceleration=0.2)
    simulation = begin(in_the_plane(start, ReversingAcceleration(reversal=10.5)))
    for _ in range(5):
        simulation.step(np.zeros((1, 1)))
    along = np.array([np.sin(0.5), np.cos(0.5)])
    # At 20 s: 0.2·10.5²/2 + 2.1·9.5 − 0.2·9.5²/2 m, and 2.1 − 1.9 m/s.
    way = 0.1 * 10.5**2 + 2.1 * 9.5 - 0.1 * 9.5**2
    np.testing.assert_allclose(simulation.truth[:2, 0], [0.0, 20e3] + way * along, rtol=1e-12)
    np.testing.assert_allclose(simulation.truth[2:4, 0], 0.2 * along, rtol=1e-9)
    np.testing.assert_allclose(simulation.truth[4:, 0], -0.2 * along, rtol=1e-12)


@pytest.mark.parametrize("start", STARTS.values(), ids=list(STARTS))
def test_motions_without_an_acceleration_ignore_it(start: Start, begin: Callable[..., Simulation]) -> None:
    simulation = begin(in_the_plane(start, ConstantVelocity()))
    assert simulation.truth.shape == (4, 1)
    np.testing.assert_array_equal(simulation.truth, start.sample(1)[:4])


def test_nuisances_do_not_take_the_place_of_accelerations(begin: Callable[..., Simulation]) -> None:
    """A start of three derivatives, a motion of two, and a carrier below: in space, where rows are nine and seven."""
    start = CartesianStart(position=(9e3, 0.0, 1e3), velocity=(1.0, 2.0, 3.0), acceleration=(7.0, 8.0, 9.0))
    changes: dict[str, Any] = {
        "target.start": start,
        "platforms": [FixedStation(position=(0.0, 0.0, 0.0))],
        "sensors": [Doppler(sigma=1.0, carrier=1e9, carrier_sigma=1e-6)],
        "prior": StatePrior(position_sigma=1e3, velocity_sigma=50.0),
        "episode.min_range": 0.0,
    }
    simulation = begin(Scenario().override(changes))
    np.testing.assert_array_equal(simulation.truth[:6], start.sample(1)[:6])
    assert simulation.truth.shape == (7, 1)
    assert abs(simulation.truth[6, 0]) < 1e-4


def test_accelerations_may_be_drawn(begin: Callable[..., Simulation]) -> None:
    start = PolarStart(range=20e3, course=np.pi / 2, acceleration=Uniform(low=0.1, high=0.3, either_sign=True))
    push = begin(in_the_plane(start, ConstantAcceleration()), 64).truth[4]
    assert len(np.unique(push)) == 64
    assert (push > 0.0).any()
    assert (push < 0.0).any()
    assert 0.1 <= np.abs(push).min() < np.abs(push).max() <= 0.3


@pytest.mark.parametrize("start", STARTS.values(), ids=list(STARTS))
def test_plain_data_keeps_the_acceleration(start: Start) -> None:
    scenario = in_the_plane(start, ConstantAcceleration())
    assert Scenario.from_json(scenario.to_json()) == Scenario.from_yaml(scenario.to_yaml()) == scenario
