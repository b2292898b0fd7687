"""One battery for every sensor: a new one is one line in the table SENSORS.

Each is tried in the plane on a turning vessel and in space on a fixed station, at the platform's centre and on a lever
arm. What a sensor means, as opposed to how it must behave, follows at the end.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from passloc_env.layout import StateLayout
from passloc_env.platforms import FixedStation, PlanarPose, Pose
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.sensors import Bearing, Doppler, Sensor
from passloc_env.sightline import Scene
from passloc_env.units import SPEED_OF_LIGHT

SENSORS: dict[str, Callable[..., Sensor]] = {
    "bearing": lambda sigma=3e-3, **mount: Bearing(sigma=sigma, **mount),
    "Doppler": lambda sigma=10.0, **mount: Doppler(sigma=sigma, carrier=3e9, **mount),
    "Doppler, unknown carrier": lambda sigma=10.0, **mount: Doppler(
        sigma=sigma, carrier=5e4, carrier_sigma=1e4, carrier_walk=1.0, propagation_speed=1e5, **mount
    ),
}
ARMS: dict[str, tuple[float, ...]] = {"centre": (), "lever arm": (40.0, -25.0, 7.0)}

CARRIER, SLOWNESS = 3e9, 1.0 / SPEED_OF_LIGHT


class Case(NamedTuple):
    sensor: Sensor
    layout: StateLayout
    platform: str

    def poses(self, size: int) -> list[Pose]:
        """Where the platform is: 200 m/s in a turn of 3°/s, or still at a height of 100 m."""
        if self.platform == "station":
            station = FixedStation(position=(500.0, -300.0, 100.0))
            return [station.pose(station.start(size))]
        spread = np.linspace(-1.0, 1.0, size)
        velocity = 200.0 * np.stack([np.sin(spread), np.cos(spread)])
        return [PlanarPose(np.stack([500.0 + spread, -300.0 * spread]), velocity, spread, np.full(size, 0.05))]

    def states(self, *shape: int, seed: int = 0) -> np.ndarray:
        """Emitters 20–60 km away in any direction, at 200 m/s, nuisances of a thousand."""
        rng = np.random.default_rng(seed)
        d, states = self.layout.dimension, np.empty((self.layout.size, *shape))
        towards = rng.normal(size=(d, *shape))
        states[self.layout.position] = towards / np.linalg.norm(towards, axis=0) * rng.uniform(20e3, 60e3, shape)
        states[self.layout.velocity] = 120.0 * rng.normal(size=(d, *shape))
        states[self.layout.nuisances] = 1e3 * rng.normal(size=(self.layout.size - 2 * d, *shape))
        return states

    def scene(self, states: np.ndarray) -> Scene:
        return Scene(states, self.layout, self.poses(states.shape[-1]))


def _case(build: Callable[..., Sensor], arm: tuple[float, ...], dimension: int) -> Case:
    sensor = build(lever_arm=arm[:dimension])
    layout = StateLayout(dimension, 1, tuple(nuisance.name for nuisance in sensor.nuisances))
    return Case(sensor, layout, "vessel" if dimension == 2 else "station")


CASES = {
    f"{name}, {place}, {dimension}-D": _case(build, arm, dimension)
    for name, build in SENSORS.items()
    for place, arm in ARMS.items()
    for dimension in (2, 3)
}


@pytest.fixture(params=CASES.values(), ids=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    found: Case = request.param
    return found


def test_jacobian_is_the_derivative(case: Case) -> None:
    """Central differences: curvature errs by (step/range)² ≈ 1e-8, rounding by 1e-16·|h|/(step·|h'|) ≈ 1e-11."""
    states = case.states(4, 20)
    jacobian = case.sensor.jacobian(case.scene(states))
    assert jacobian.shape == (case.sensor.size, *states.shape)
    for row in range(case.layout.size):
        step = np.zeros_like(states)
        step[row] = 2.0
        ahead, behind = (case.sensor.measure(case.scene(states + sign * step)) for sign in (1, -1))
        difference = SensorSuite((case.sensor,)).difference(ahead, behind) / 4.0
        scale = np.abs(jacobian[:, row]).max()
        np.testing.assert_allclose(jacobian[:, row], difference, rtol=1e-6, atol=1e-6 * scale + 1e-30)


def test_jacobian_predicts_every_small_step_of_a_circle(case: Case) -> None:
    """The emitter circles the platform once: differences never jump, and an angle adds up to its whole turn."""
    steps = 400
    turn = np.linspace(0.0, 2.0 * np.pi, steps + 1)
    states = case.states(1)[:, :1] * np.ones(steps + 1)
    poses = [pose.mounted(case.sensor.lever_arm) for pose in case.poses(1)]
    radius = np.stack([30e3 * np.sin(turn), 30e3 * np.cos(turn)])
    states[:2] = poses[0].position[:2] + radius
    measured = case.sensor.measure(Scene(states, case.layout, case.poses(1)))
    jacobian = case.sensor.jacobian(Scene(states, case.layout, case.poses(1)))
    found = SensorSuite((case.sensor,)).difference(measured[:, 1:], measured[:, :-1])
    # The trapezium rule errs by (step angle)²/12 = 2e-5 of the largest step.
    slope = 0.5 * (jacobian[..., 1:] + jacobian[..., :-1])
    expected = np.einsum("mnN,nN->mN", slope, np.diff(states))
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    for row, angular in enumerate(case.sensor.angular):
        assert found[row].sum() == pytest.approx(2.0 * np.pi if angular else 0.0, abs=1e-6)


def test_measurement_has_its_size_and_keeps_middle_axes(case: Case) -> None:
    states = case.states(5, 3, 7)
    measured, jacobian = case.sensor.measure(case.scene(states)), case.sensor.jacobian(case.scene(states))
    assert measured.shape == (case.sensor.size, 5, 3, 7)
    assert len(case.sensor.angular) == case.sensor.size
    for i, j in np.ndindex(5, 3):
        alone = case.scene(states[:, i, j].copy())
        assert case.sensor.measure(alone).tobytes() == measured[:, i, j].tobytes()
        assert case.sensor.jacobian(alone).tobytes() == jacobian[:, :, i, j].tobytes()


def test_bits_do_not_depend_on_the_batch(case: Case, assert_batch_free: Callable[..., None]) -> None:
    states = case.states(300)
    pose = case.poses(300)[0]
    if isinstance(pose, PlanarPose):
        rebuild = lambda p, v, h: PlanarPose(p, v, h, np.full(len(h), 0.05))  # noqa: E731
        arrays = [pose.position, pose.velocity, pose.heading]
    else:
        rebuild = lambda p: Pose(p, 0.0 * p, 0.0 * p)  # noqa: E731
        arrays = [pose.position]

    def both(states: np.ndarray, *pose: np.ndarray) -> np.ndarray:
        scene = Scene(states, case.layout, [rebuild(*pose)])
        return np.concatenate([case.sensor.measure(scene), case.sensor.jacobian(scene)[0]])

    assert_batch_free(both, states, *arrays)


def test_noise_has_the_covariance_it_declares(case: Case) -> None:
    suite, draws = SensorSuite((case.sensor,)), 50_000
    declared = case.sensor.noise_covariance()[..., 0]
    np.testing.assert_array_equal(declared, declared.T)
    assert (np.linalg.eigvalsh(declared) > 0.0).all()
    unit = suite.noise(np.eye(case.sensor.size))
    np.testing.assert_allclose(unit @ unit.T, declared, rtol=1e-14)
    sample = np.atleast_2d(np.cov(suite.noise(np.random.default_rng(1).standard_normal((case.sensor.size, draws)))))
    # Five standard deviations of a sample covariance: by chance less than once in a million seeds per entry.
    spread = np.sqrt((np.outer(np.diag(declared), np.diag(declared)) + declared**2) / draws)
    assert (np.abs(sample - declared) <= 5.0 * spread).all()


@pytest.mark.parametrize("name", SENSORS)
def test_sigma_may_differ_between_environments(name: str) -> None:
    sensor, sigma = SENSORS[name](), np.array([1e-3, 2.0, 30.0])
    object.__setattr__(sensor, "sigma", sigma)
    np.testing.assert_allclose(sensor.noise_covariance(), (sigma**2)[None, None], rtol=1e-15)


def test_zero_range_is_finite(case: Case) -> None:
    pose = case.poses(3)[0].mounted(case.sensor.lever_arm)
    states = case.states(3)
    states[case.layout.position] = pose.position
    states[case.layout.velocity, 1] = pose.velocity[:, 1]
    assert np.isfinite(case.sensor.measure(case.scene(states))).all()
    assert np.isfinite(case.sensor.jacobian(case.scene(states))).all()


def test_only_relative_motion_counts(case: Case) -> None:
    """Shift and speed up emitter and platform together: nothing changes. 1e6 m cost seven of sixteen digits."""
    states, pose = case.states(6), case.poses(6)[0]
    shifted = states.copy()
    shifted[case.layout.position] += 1e6
    shifted[case.layout.velocity] += 300.0
    moved = Pose(pose.position + 1e6, pose.velocity + 300.0, pose.acceleration, pose.attitude, pose.attitude_rate)
    measured = case.sensor.measure(Scene(states, case.layout, [pose]))
    found = case.sensor.measure(Scene(shifted, case.layout, [moved]))
    np.testing.assert_allclose(found, measured, rtol=1e-7, atol=1e-7)


# What each sensor means.


def simple_scene(position: Any, velocity: Any, nuisance: tuple[float, ...] = ()) -> Scene:
    """One emitter seen from a station at the origin."""
    d = len(position)
    state = np.array([*position, *velocity, *nuisance], float)[:, None]
    names = ("carrier_offset",)[: len(nuisance)]
    return Scene(state, StateLayout(d, 1, names), [Pose(*np.zeros((3, d, 1)))])


@pytest.mark.parametrize(
    ("position", "degrees"),
    [((0, 5), 0), ((5, 0), 90), ((0, -5), 180), ((-5, 0), -90), ((5, 5, 100), 45), ((-1, -1, -3), -135)],
)
def test_bearing_is_clockwise_from_north(position: tuple[float, ...], degrees: float) -> None:
    scene = simple_scene(position, np.zeros(len(position)))
    assert np.degrees(Bearing(sigma=1.0).measure(scene)[0, 0]) == pytest.approx(degrees)


def received_frequency(position: np.ndarray, velocity: np.ndarray, frequency: float) -> float:
    """First-order Doppler by counting wave crests: f (1 − dr/dt / c), the range differentiated numerically."""
    step = 1e-2
    closing = (np.linalg.norm(position - step * velocity) - np.linalg.norm(position + step * velocity)) / (2 * step)
    return frequency * (1.0 + closing * SLOWNESS)


@pytest.mark.parametrize("offset", [0.0, 4e3])
@pytest.mark.parametrize("position", [(3e4, 4e4), (-1e4, 2e4, 5e3)])
def test_doppler_is_a_shift_from_the_nominal_carrier(position: tuple[float, ...], offset: float) -> None:
    velocity = np.array([150.0, -80.0, 20.0])[: len(position)]
    sensor = Doppler(sigma=10.0, carrier=CARRIER, carrier_sigma=1e4)
    shift = sensor.measure(simple_scene(position, velocity, (offset,)))[0, 0]
    expected = received_frequency(np.array(position), velocity, CARRIER + offset) - CARRIER
    assert shift == pytest.approx(expected, abs=1e-3)  # the difference of two numbers of 3e9 Hz
    if offset == 0.0:
        assert SENSORS["Doppler"]().measure(simple_scene(position, velocity))[0, 0] == pytest.approx(shift, rel=1e-12)


def test_approaching_emitters_sound_higher() -> None:
    shift = SENSORS["Doppler"]().measure(simple_scene((0.0, 1e4), (0.0, -SPEED_OF_LIGHT / 3e6)))
    assert shift[0, 0] == pytest.approx(1e3)


def test_propagation_speed_is_the_mediums() -> None:
    sonar = Doppler(sigma=1.0, carrier=1000.0, propagation_speed=1500.0)
    assert sonar.measure(simple_scene((0.0, 1e3), (0.0, 15.0)))[0, 0] == pytest.approx(-10.0)


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


@pytest.mark.parametrize(
    ("name", "expected"),
    [("bearing", []), ("Doppler", []), ("Doppler, unknown carrier", [("carrier_offset", 1e4, 1.0)])],
)
def test_nuisances_are_declared(name: str, expected: list[tuple[str, float, float]]) -> None:
    found = nuisances((SENSORS[name](),))
    assert [(nuisance.name, nuisance.sigma, nuisance.walk) for nuisance in found] == expected
