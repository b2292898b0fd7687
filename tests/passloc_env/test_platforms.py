"""Observers fly what they are told, at constant speed, and know where they are and how they turn."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from passloc_env.angles import bearing_of, direction, wrap
from passloc_env.errors import ScenarioError
from passloc_env.noise import NavigationErrors
from passloc_env.platforms import FixedStation, PlanarPose, Platform, Pose, TurnLimitedPlatform

SPEED, RATE, PERIOD = 220.0, 0.05, 4.0
TURNING = TurnLimitedPlatform(speed=SPEED, max_turn_rate=RATE)
STEERED = TurnLimitedPlatform(speed=SPEED, max_turn_rate=RATE, control="turn_rate")
AGILE = TurnLimitedPlatform(speed=SPEED, max_turn_rate=math.inf)

ANGLES = st.floats(-math.pi, math.pi)
# Kilometres flown, integrated to 1e-12 of them.
INTEGRATED = {"rtol": 1e-9, "atol": 1e-6}


def state_at(heading: float) -> np.ndarray:
    return replace(TURNING, position=(1e3, -2e3), heading=heading).start(1)


def turning_state() -> np.ndarray:
    state = state_at(0.8)
    state[3] = RATE
    return state


def integrate(state: np.ndarray, legs: list[tuple[float, float]]) -> np.ndarray:
    """East, north and heading after legs of (turn rate, seconds) flown at constant speed."""
    flown = state[:3, 0]
    for rate, seconds in legs:
        slope = lambda _, y, rate=rate: [SPEED * math.sin(y[2]), SPEED * math.cos(y[2]), rate]  # noqa: E731
        flown = solve_ivp(slope, (0.0, seconds), flown, method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1]
    return flown


def assert_flown(moved: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(moved[:2, 0], expected[:2], **INTEGRATED)
    assert wrap(moved[2, 0] - expected[2]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("heading", "wanted", "legs", "rate"),
    [
        pytest.param(0.3, 0.3, [(0.0, 4.0)], 0.0, id="straight"),
        pytest.param(0.3, 0.4, [(RATE, 2.0), (0.0, 2.0)], 0.0, id="starboard, then straight"),
        pytest.param(0.3, 0.25, [(-RATE, 1.0), (0.0, 3.0)], 0.0, id="port, then straight"),
        pytest.param(0.3, 2.0, [(RATE, 4.0)], RATE, id="not there yet"),
        pytest.param(0.3, -2.0, [(-RATE, 4.0)], -RATE, id="not there yet, to port"),
        pytest.param(
            3.1, -3.1, [(RATE, 2 * (math.pi - 3.1) / RATE), (0.0, 4.0 - 2 * (math.pi - 3.1) / RATE)], 0.0, id="cut"
        ),
        pytest.param(-3.1, 2.0, [(-RATE, 4.0)], -RATE, id="the short way"),
    ],
)
def test_heading_is_flown_as_an_arc_then_straight(
    heading: float, wanted: float, legs: list[tuple[float, float]], rate: float
) -> None:
    state = state_at(heading)
    moved = TURNING.move(state, np.array([[wanted]]), PERIOD)
    assert_flown(moved, integrate(state, legs))
    assert moved[3, 0] == pytest.approx(rate)


@pytest.mark.parametrize("action", [-1.0, -0.3, 0.0, 1e-9, 0.7])
def test_turn_rate_is_flown_as_an_arc(action: float) -> None:
    state = state_at(1.0)
    moved = STEERED.move(state, STEERED.set_point(state, np.array([[action]]), np.ones((2, 1))), PERIOD)
    assert_flown(moved, integrate(state, [(action * RATE, PERIOD)]))
    assert moved[3, 0] == pytest.approx(action * RATE)


@pytest.mark.parametrize("wanted", [0.0, 1.0, -3.0, math.pi])
def test_infinite_rate_turns_on_the_spot(wanted: float) -> None:
    moved = AGILE.move(state_at(0.5), np.array([[wanted]]), PERIOD)
    expected = [1e3 + SPEED * PERIOD * math.sin(wanted), -2e3 + SPEED * PERIOD * math.cos(wanted), wanted]
    assert_flown(moved, np.array(expected))
    assert moved[3, 0] == 0.0


@given(ANGLES, ANGLES, st.sampled_from([TURNING, STEERED, AGILE]))
def test_speed_is_constant_and_never_exceeded(heading: float, wanted: float, platform: TurnLimitedPlatform) -> None:
    state = state_at(heading)
    moved = platform.move(state, platform.set_point(state, np.array([[wanted / np.pi]]), np.ones((2, 1))), PERIOD)
    assert math.hypot(*(moved - state)[:2, 0]) <= SPEED * PERIOD * (1 + 1e-12)
    pose = platform.pose(moved)
    assert np.hypot(*pose.velocity) == pytest.approx(SPEED)
    assert wrap(bearing_of(pose.velocity) - pose.heading) == pytest.approx(0.0, abs=1e-9)


@given(ANGLES, st.floats(-1.0, 1.0))
def test_heading_command_is_relative_to_the_line_of_sight(sight: float, action: float) -> None:
    set_point = AGILE.set_point(state_at(0.7), np.array([[action]]), direction(np.array([sight])))
    moved = AGILE.move(state_at(0.7), set_point, PERIOD)
    assert set_point.shape == (1, 1)
    assert wrap(moved[2, 0] - sight - np.pi * action) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("action", "side"), [(0.0, (0, 1)), (0.5, (1, 0)), (-0.5, (-1, 0)), (1.0, (0, -1))])
def test_positive_commands_put_the_emitter_to_port(action: float, side: tuple[int, int]) -> None:
    """With the emitter due north, half to starboard flies east."""
    set_point = AGILE.set_point(state_at(0.7), np.array([[action]]), np.array([[0.0], [5.0]]))
    velocity = AGILE.pose(AGILE.move(state_at(0.7), set_point, PERIOD)).velocity
    np.testing.assert_allclose(velocity[:, 0], SPEED * np.array(side), atol=1e-9)


@given(ANGLES, ANGLES, ANGLES, st.sampled_from([TURNING, STEERED]))
def test_action_towards_is_the_inverse_of_flying(
    wanted: float, heading: float, sight: float, platform: TurnLimitedPlatform
) -> None:
    """After one decision the heading is the wanted one, or as near as the turn rate allows."""
    interval = 8.0
    state = state_at(heading)
    angles = (np.array([angle]) for angle in (wanted, heading, sight))
    action = platform.action_towards(*angles, interval)
    assert abs(action[0]) <= 1.0 + 1e-12
    set_point = platform.set_point(state, action[None], direction(np.array([sight])))
    for _ in range(2):
        state = platform.move(state, set_point, interval / 2)
    missing = wrap(wanted - heading)
    flown = wrap(state[2, 0] - heading)
    if abs(missing) < math.pi - 1e-6:  # exactly astern either way is right
        assert flown == pytest.approx(np.clip(missing, -RATE * interval, RATE * interval), abs=1e-9)


def test_the_set_point_is_held_over_the_steps_of_a_decision() -> None:
    state, fine = state_at(0.0), state_at(0.0)
    set_point = np.array([[0.33]])
    for _ in range(10):
        fine = TURNING.move(fine, set_point, 1.0)
    np.testing.assert_allclose(fine[:3], TURNING.move(state, set_point, 10.0)[:3], **INTEGRATED)


PLATFORMS: list[tuple[Platform, np.ndarray]] = [
    (FixedStation(position=(3.0, 4.0)), np.array([[3.0], [4.0]])),
    (FixedStation(position=(3.0, 4.0, 5.0)), np.array([[3.0], [4.0], [5.0]])),
    (TURNING, turning_state()),
]


@pytest.mark.parametrize(("platform", "state"), PLATFORMS, ids=["plane", "space", "turning"])
def test_attitude_is_orthonormal_and_forward_first(platform: Platform, state: np.ndarray) -> None:
    pose = platform.pose(state)
    axes, rate = pose.attitude[..., 0], pose.attitude_rate[..., 0]
    np.testing.assert_allclose(axes @ axes.T, np.eye(platform.dimension), atol=1e-15)
    np.testing.assert_allclose(rate @ axes.T, -(rate @ axes.T).T, atol=1e-15)
    speed = np.linalg.norm(pose.velocity)
    if speed:
        np.testing.assert_allclose(axes[0], pose.velocity[:, 0] / speed, atol=1e-15)
        starboard = np.array([axes[0, 1], -axes[0, 0]])
        np.testing.assert_allclose(axes[1], starboard, atol=1e-15)


@pytest.mark.parametrize(("platform", "state"), PLATFORMS, ids=["plane", "space", "turning"])
@pytest.mark.parametrize("arm", [(), (30.0, -12.0)], ids=["centre", "lever arm"])
def test_mounted_pose_moves_as_it_says(platform: Platform, state: np.ndarray, arm: tuple[float, ...]) -> None:
    """Along a steady turn, velocity and acceleration are the time derivatives of where the point is."""
    if arm and platform.dimension == 3:
        arm = (*arm, 4.0)
    step = 1e-3  # central differences err by step²·ω²/6 ≈ 4e-10 of the value, and rounding by 1e-13/step

    def mounted(time: float) -> Pose:
        if platform is not TURNING:
            return platform.pose(state).mounted(arm)
        return STEERED.pose(STEERED.move(state, np.array([[RATE]]), time)).mounted(arm)

    before, now, after = mounted(-step), mounted(0.0), mounted(step)
    for value, slope in (("position", "velocity"), ("velocity", "acceleration"), ("attitude", "attitude_rate")):
        difference = (getattr(after, value) - getattr(before, value)) / (2 * step)
        np.testing.assert_allclose(difference, getattr(now, slope), rtol=1e-7, atol=1e-8)


def test_lever_arm_by_hand() -> None:
    """Heading east: forward is east, starboard is south."""
    pose = PlanarPose(np.zeros((2, 1)), np.array([[10.0], [0.0]]), np.array([math.pi / 2]), np.zeros(1))
    np.testing.assert_allclose(pose.mounted((3.0, 2.0)).position[:, 0], [3.0, -2.0], atol=1e-15)
    assert pose.mounted(()) is pose


def test_fixed_stations_stay() -> None:
    station = FixedStation(position=(3.0, 4.0))
    state = station.start(5)
    np.testing.assert_array_equal(state, np.array([[3.0], [4.0]]) * np.ones(5))
    np.testing.assert_array_equal(station.move(state, station.set_point(state, np.zeros((0, 5)), state), 9.0), state)
    assert not station.pose(state).velocity.any()
    assert not station.pose(state).acceleration.any()
    assert station.controls == 0


def test_platforms_start_where_they_are_told_to() -> None:
    platform = TurnLimitedPlatform(position=(3.0, 4.0), heading=1.0, speed=2.0, max_turn_rate=1.0)
    pose = platform.pose(platform.start(2))
    assert platform.reported_pose(platform.start(2), pose, NavigationErrors(*np.zeros((2, 0, 2)))) is pose
    np.testing.assert_array_equal(pose.position, [[3.0] * 2, [4.0] * 2])
    np.testing.assert_allclose(pose.velocity, 2.0 * direction(np.ones(2)))
    np.testing.assert_array_equal(pose.acceleration, 0.0)


@pytest.mark.parametrize(("platform", "state"), PLATFORMS, ids=["plane", "space", "turning"])
def test_joined_poses_are_the_pose_of_the_joined_state(platform: Platform, state: np.ndarray) -> None:
    pose = platform.pose(state)
    joined = type(pose).join([pose, platform.pose(state + 1.0)])
    whole = platform.pose(np.concatenate([state, state + 1.0], axis=-1))
    for name in ("position", "velocity", "acceleration", "attitude", "attitude_rate"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))


@pytest.mark.parametrize("platform", [TURNING, STEERED, AGILE], ids=["heading", "turn rate", "infinite rate"])
def test_bits_do_not_depend_on_the_batch(platform: TurnLimitedPlatform, assert_batch_free: Callable[..., None]) -> None:
    rng = np.random.default_rng(0)
    states = np.concatenate([state_at(heading) for heading in rng.uniform(-3, 3, 300)], axis=-1)
    actions = rng.uniform(-1, 1, (1, 300))

    def fly(state: np.ndarray, action: np.ndarray) -> np.ndarray:
        moved = platform.move(state, platform.set_point(state, action, state[:2]), PERIOD)
        pose = platform.pose(moved).mounted((1.0, 2.0))
        return np.concatenate([moved, pose.position, pose.velocity, pose.acceleration])

    assert_batch_free(fly, states, actions)


@pytest.mark.parametrize(
    ("fields", "field"),
    [({"position": (1.0,)}, "position"), ({"control": "turn_rate", "max_turn_rate": math.inf}, "max_turn_rate")],
)
def test_impossible_platforms(fields: dict[str, Any], field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        TurnLimitedPlatform(**{"speed": 1.0, "max_turn_rate": 1.0, **fields})
    assert caught.value.field == field


@pytest.mark.parametrize("platform", [TURNING, STEERED, AGILE], ids=["heading", "turn rate", "infinite rate"])
@pytest.mark.parametrize("heading", [0.0, 2.0, -3.1])
def test_the_state_of_a_pose(platform: TurnLimitedPlatform, heading: float) -> None:
    """A forecast may go on from where the platform is: the same state to the bits of a sine."""
    state = state_at(heading)
    for action in (0.3, -0.9):
        held = platform.set_point(state, np.array([[action]]), np.array([[0.6], [0.8]]))
        state = platform.move(state, held, PERIOD)
        again = platform.state_at(platform.pose(state))
        np.testing.assert_allclose(again, state, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(
            platform.move(again, held, PERIOD), platform.move(state, held, PERIOD), rtol=1e-13, atol=1e-10
        )


def test_the_state_of_a_station_is_its_position() -> None:
    station = FixedStation(position=(3.0, -4.0, 5.0))
    state = station.start(2)
    np.testing.assert_array_equal(station.state_at(station.pose(state)), state)


def test_a_platform_without_that_cannot_be_planned_for() -> None:
    with pytest.raises(AssertionError, match="Platform must define state_at"):
        Platform().state_at(TURNING.pose(state_at(0.0)))
