"""What each sensor means: its value in cases that can be worked out by other means."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.platforms import FixedStation, PlanarPose, Pose, TurnLimitedPlatform
from passloc_env.scenario import Scenario
from passloc_env.sensors import Bearing, Doppler, PhaseDifference, RadialAcceleration, Sensor, TimeDifference
from passloc_env.sightline import Scene
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import StatePrior
from passloc_env.units import SPEED_OF_LIGHT

CARRIER = 3e9
KNOWN = Doppler(sigma=10.0, carrier=CARRIER)


def simple_scene(position: Any, velocity: Any, nuisance: tuple[float, ...] = ()) -> Scene:
    """One emitter seen from a station at the origin."""
    d = len(position)
    state = np.array([*position, *velocity, *nuisance], float)[:, None]
    names = ("carrier_offset",)[: len(nuisance)]
    return Scene(state, StateLayout(d, 1, names), [Pose(*np.zeros((3, d, 1)))])


# Bearing.


@pytest.mark.parametrize(
    ("position", "degrees"),
    [((0, 5), 0), ((5, 0), 90), ((0, -5), 180), ((-5, 0), -90), ((5, 5, 100), 45), ((-1, -1, -3), -135)],
)
def test_bearing_is_clockwise_from_north(position: tuple[float, ...], degrees: float) -> None:
    scene = simple_scene(position, np.zeros(len(position)))
    assert np.degrees(Bearing(sigma=1.0).measure(scene)[0, 0]) == pytest.approx(degrees)


def test_the_law_of_errors_is_one_of_two(refusal: Callable[..., ScenarioError]) -> None:
    assert Bearing(sigma=1.0).noise_law == "gaussian"
    assert refusal(lambda: Bearing(sigma=1.0, noise_law="cauchy")).field == "noise_law"


# Doppler.


def received_frequency(position: np.ndarray, velocity: np.ndarray, frequency: float) -> float:
    """First-order Doppler by counting wave crests: f (1 − dr/dt / c), the range differentiated numerically."""
    step = 1e-2
    closing = (np.linalg.norm(position - step * velocity) - np.linalg.norm(position + step * velocity)) / (2 * step)
    return float(frequency * (1.0 + closing / SPEED_OF_LIGHT))


@pytest.mark.parametrize("offset", [0.0, 4e3])
@pytest.mark.parametrize("position", [(3e4, 4e4), (-1e4, 2e4, 5e3)])
def test_doppler_is_a_shift_from_the_nominal_carrier(position: tuple[float, ...], offset: float) -> None:
    velocity = np.array([150.0, -80.0, 20.0])[: len(position)]
    sensor = Doppler(sigma=10.0, carrier=CARRIER, carrier_sigma=1e4)
    shift = sensor.measure(simple_scene(position, velocity, (offset,)))[0, 0]
    expected = received_frequency(np.array(position), velocity, CARRIER + offset) - CARRIER
    assert shift == pytest.approx(expected, abs=1e-3)  # the difference of two numbers of 3e9 Hz
    if offset == 0.0:
        assert KNOWN.measure(simple_scene(position, velocity))[0, 0] == pytest.approx(shift, rel=1e-12)


def test_approaching_emitters_sound_higher() -> None:
    shift = KNOWN.measure(simple_scene((0.0, 1e4), (0.0, -SPEED_OF_LIGHT / 3e6)))
    assert shift[0, 0] == pytest.approx(1e3)


def test_propagation_speed_is_the_mediums() -> None:
    sonar = Doppler(sigma=1.0, carrier=1000.0, propagation_speed=1500.0)
    assert sonar.measure(simple_scene((0.0, 1e3), (0.0, 15.0)))[0, 0] == pytest.approx(-10.0)


# Lever arms.


def test_lever_arm_of_a_turning_vessel_adds_its_speed() -> None:
    """10 m forward on a bow that turns 0.1 rad/s to starboard moves 1 m/s to starboard."""
    pose = PlanarPose(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(1), np.full(1, 0.1))
    scene = Scene(np.array([[1e6], [10.0], [0.0], [0.0]]), StateLayout(), [pose])
    sonar = Doppler(sigma=1.0, carrier=1500.0, propagation_speed=1500.0, lever_arm=(10.0, 0.0))
    assert sonar.measure(scene)[0, 0] == pytest.approx(1.0, rel=1e-9)


def test_computed_lever_arms_are_not_confused() -> None:
    """A sensor with several antennas computes its arms on the fly: numbers whose memory is used again at once."""
    pose = PlanarPose(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(1), np.zeros(1))
    scene = Scene(np.array([[0.0], [1e3], [0.0], [0.0]]), StateLayout(), [pose])
    ranges = [scene.sightline(0, (arm * 1.5, 0.0)).range[0] for arm in range(10)]
    assert ranges == [1e3 - arm * 1.5 for arm in range(10)]


# Radial acceleration.

HEARD = RadialAcceleration(sigma=0.1)


@pytest.mark.parametrize("along", [-40e3, -1e3, 0.0, 7e3, 90e3])
@pytest.mark.parametrize("dimension", [2, 3])
def test_radial_acceleration_of_a_straight_track(along: float, dimension: int) -> None:
    """``D² v²/r³`` with D the distance of the track (paper 002, eq. 4), from a station at rest."""
    distance, speed = 12e3, 250.0
    axes = np.linalg.qr(np.random.default_rng(dimension).normal(size=(dimension, dimension)))[0]
    position, velocity = distance * axes[0] + along * axes[1], speed * axes[1]
    found = HEARD.measure(simple_scene(position, velocity))[0, 0]
    assert found == pytest.approx(distance**2 * speed**2 / np.hypot(distance, along) ** 3, rel=1e-9)


def second_derivative(value: Callable[[float], float], step: float = 0.5) -> float:
    """Five-point formula: errs by step⁴ times a ninetieth of the sixth derivative."""
    weights = (-1.0, 16.0, -30.0, 16.0, -1.0)
    return sum(w * value(k * step) for w, k in zip(weights, range(-2, 3), strict=True)) / (12.0 * step**2)


@pytest.mark.parametrize("arm", [(), (30.0, -12.0)], ids=["centre", "lever arm"])
@pytest.mark.parametrize("order", [1, 2])
def test_radial_acceleration_is_the_second_derivative_of_the_range(order: int, arm: tuple[float, ...]) -> None:
    """The emitter accelerates and so does the observer, an aircraft at 220 m/s that turns by 0.05 rad/s.

    Differences err by step⁴·V ω⁵/90 = 5e-8 m/s² (V = 220 m/s, ω = 0.05 rad/s) and by rounding, 4e4·1e-16/step² = 1e-11.
    """
    rate = 0.05
    aircraft = TurnLimitedPlatform(
        position=(1e3, -2e3), heading=0.7, speed=220.0, max_turn_rate=rate, control="turn_rate"
    )
    turn = np.array([[rate]])
    now = aircraft.move(aircraft.start(1), turn, 10.0)
    state = np.array([[14e3], [-30e3], [-120.0], [90.0], [2.5], [-1.0]])[: 2 * (order + 1)]
    position, velocity = state[:2], state[2:4]
    push = state[4:] if order == 2 else np.zeros((2, 1))

    def distance(time: float) -> float:
        own = aircraft.pose(aircraft.move(now, turn, time)).mounted(arm).position
        return float(np.linalg.norm(position + time * velocity + 0.5 * time**2 * push - own))

    sensor = RadialAcceleration(sigma=0.1, lever_arm=arm)
    pose = aircraft.pose(now)
    found = sensor.measure(Scene(state, StateLayout(2, order), [pose]))[0, 0]
    assert found == pytest.approx(second_derivative(distance), abs=1e-6)
    # The aircraft's own 11 m/s² is most of it.
    deaf = Pose(pose.position, pose.velocity, 0.0 * pose.position, pose.attitude, pose.attitude_rate)
    assert abs(found - sensor.measure(Scene(state, StateLayout(2, order), [deaf]))[0, 0]) > 5.0


# Phase differences.

PHASE = partial(PhaseDifference, sigma=0.1, baseline=1.5, carrier=CARRIER)
WAVELENGTH = SPEED_OF_LIGHT / CARRIER
BODY = Rotation.from_rotvec([0.4, -1.1, 0.8]).as_matrix()
"""Axes of a body in space, by row."""


def seen_by(axes: np.ndarray, towards: np.ndarray, tilts: tuple[float, ...] = ()) -> Scene:
    """An emitter 5000 km from a body at the origin; ``tilts`` are its misalignments."""
    d = len(towards)
    names = tuple(f"{turn}_error_0" for turn in ("roll", "pitch", "yaw"))[: len(tilts)]
    state = np.array([*(5e6 * towards / np.linalg.norm(towards)), *np.zeros(d), *tilts])[:, None]
    rest = np.zeros((d, 1))
    return Scene(state, StateLayout(d, 1, names), [Pose(rest, rest, rest, axes[..., None], 0.0 * axes[..., None])])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("towards", [(1.0, 0.2, -0.3), (-0.1, 2.0, 0.4), (0.3, 0.1, 0.9)])
def test_phase_is_that_of_the_path_difference(axis: int, towards: tuple[float, ...]) -> None:
    """The leading antenna lies half a baseline along the axis and is nearer: 2π (r₋ − r₊)/λ.

    A range of 5e6 m is rounded to 1e-9 m, which is 6e-8 rad; the curvature of the wave cancels between the two.
    """
    direction = np.array(towards) / np.linalg.norm(towards)
    arm = 0.75 * BODY[axis]
    behind, ahead = (np.linalg.norm(5e6 * direction - sign * arm) for sign in (-1.0, 1.0))
    expected = 2.0 * np.pi * (behind - ahead) / WAVELENGTH
    found = PHASE(axis=axis).measure(seen_by(BODY, direction))[0, 0]
    assert found == pytest.approx(expected, abs=1e-6)
    assert found == pytest.approx(2.0 * np.pi * 1.5 / WAVELENGTH * (BODY[axis] @ direction), rel=1e-12)


def test_phase_in_the_plane() -> None:
    """Heading north with the emitter 30° to starboard: cosines of 30° and 60°; phases run on beyond a turn."""
    pose = PlanarPose(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(1), np.zeros(1))
    scene = Scene(np.array([[0.5e4], [np.sqrt(0.75) * 1e4], [0.0], [0.0]]), StateLayout(), [pose])
    found = [PHASE(axis=axis).measure(scene)[0, 0] * WAVELENGTH / (2.0 * np.pi * 1.5) for axis in (0, 1)]
    np.testing.assert_allclose(found, [np.sqrt(0.75), 0.5], rtol=1e-12)
    assert PHASE().measure(scene)[0, 0] > 2.0 * np.pi


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("about", [0, 1, 2, None], ids=["roll", "pitch", "yaw", "all"])
def test_misalignment_is_a_turn_of_the_body(axis: int, about: int | None) -> None:
    """To first order: what is left falls with the square of the angle, and is at most half of it for each turn."""
    sensor, towards = PHASE(axis=axis, misalignment_sigma=1e-3), np.array([0.5, -0.3, 0.8])
    scale, left = 2.0 * np.pi * 1.5 / WAVELENGTH, []
    for angle in (2e-3, 1e-3):
        tilts = angle * (np.ones(3) if about is None else np.eye(3)[about])
        turned = Rotation.from_rotvec(BODY.T @ tilts).apply(BODY)
        expected = PHASE(axis=axis).measure(seen_by(turned, towards))[0, 0]
        left.append((sensor.measure(seen_by(BODY, towards, tuple(tilts)))[0, 0] - expected) / scale)
        assert abs(left[-1]) <= 0.5 * (tilts @ tilts) * (1.0 + angle)
        if about is not None and about != axis:
            straight = PHASE(axis=axis).measure(seen_by(BODY, towards))[0, 0]
            assert abs(expected - straight) / scale > 0.1 * angle
    if about == axis:
        np.testing.assert_allclose(left, 0.0, atol=1e-12)
    else:
        assert left[0] / left[1] == pytest.approx(4.0, rel=0.02)


def test_interferometers_of_one_body_share_its_misalignment() -> None:
    names = [n.name for axis in (0, 1) for n in PHASE(axis=axis, platform=1, misalignment_sigma=1e-3).nuisances]
    assert names == ["roll_error_1", "pitch_error_1", "yaw_error_1"] * 2


# Time differences.


def test_time_difference_is_how_much_later_the_other_hears_it() -> None:
    """The other is 3 km farther away: 10 µs later. Exchanged, it hears it first."""
    rest = np.zeros((2, 1))
    first, other = Pose(rest, rest), Pose(np.array([[0.0], [-3e3]]), rest)
    state = np.array([[0.0], [7e3], [50.0], [0.0]])
    sensor = TimeDifference(sigma=1e-7)
    scene = Scene(state, StateLayout(), [first, other])
    found = sensor.measure(scene)[0, 0]
    assert found == pytest.approx(3e3 / SPEED_OF_LIGHT, rel=1e-12)
    swapped = TimeDifference(sigma=1e-7, platform=1, other=0)
    assert swapped.measure(scene)[0, 0] == -found
    np.testing.assert_array_equal(swapped.jacobian(scene), -sensor.jacobian(scene))


def test_time_difference_of_two_antennas_on_one_vessel() -> None:
    """A pulse from ahead reaches the bow first: 400 m at 1500 m/s are 0.267 s."""
    vessel = PlanarPose(np.zeros((2, 1)), np.zeros((2, 1)), np.full(1, 0.5 * np.pi), np.zeros(1))
    scene = Scene(np.array([[9e3], [0.0], [0.0], [0.0]]), StateLayout(), [vessel])
    sonar = TimeDifference(
        sigma=1e-3, other=0, lever_arm=(300.0, 0.0), other_lever_arm=(-100.0, 0.0), propagation_speed=1500.0
    )
    assert sonar.measure(scene)[0, 0] == pytest.approx(400.0 / 1500.0, rel=1e-12)


# What does not fit.


def scenario_with(sensor: Sensor, dimension: int) -> Scenario:
    """Two stations and an emitter, with one sensor."""
    axes = (0.0,) * dimension
    return Scenario(
        target=Target(start=CartesianStart(position=(30e3, *axes[1:]), velocity=axes)),
        platforms=(FixedStation(position=axes),) * 2,
        sensors=(sensor,),
        prior=StatePrior(position_sigma=1.0, velocity_sigma=1.0),
    )


@pytest.mark.parametrize(
    ("sensor", "dimension", "field"),
    [
        (PHASE(axis=2), 2, "sensors.0.axis"),
        (PHASE(axis=3), 3, "sensors.0.axis"),
        (PHASE(misalignment_sigma=1e-3), 2, "sensors.0.misalignment_sigma"),
        (TimeDifference(sigma=1e-7, other_lever_arm=(1.0, 2.0, 3.0)), 2, "sensors.0.other_lever_arm"),
        (TimeDifference(sigma=1e-7, other=2), 2, "sensors.0.other"),
        (TimeDifference(sigma=1e-7, platform=2), 2, "sensors.0.platform"),
    ],
)
def test_what_does_not_fit_is_refused(
    sensor: Sensor, dimension: int, field: str, refusal: Callable[..., ScenarioError]
) -> None:
    assert refusal(scenario_with, sensor, dimension).field == field


@pytest.mark.parametrize("arm", [(), (1.0, 2.0)])
def test_a_time_difference_needs_two_places(arm: tuple[float, ...], refusal: Callable[..., ScenarioError]) -> None:
    same = {"sigma": 1e-7, "platform": 1, "other": 1, "lever_arm": arm, "other_lever_arm": arm}
    assert refusal(lambda: TimeDifference(**same)).field == "other"
