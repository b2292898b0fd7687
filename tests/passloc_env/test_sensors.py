"""One battery for every sensor: a new one is one line in the table SENSORS.

Each is tried, where it fits, in the plane on turning vessels and in space on a tumbling body, at the platform's centre
and on a lever arm, with and without accelerations in the state. What a sensor means, as opposed to how it must behave,
is tested in test_sensor_meanings.py.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.platforms import PlanarPose, Pose
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.sensors import Bearing, Doppler, PhaseDifference, RadialAcceleration, Sensor, TimeDifference
from passloc_env.sightline import Scene

INTERFEROMETER = partial(PhaseDifference, sigma=0.1, baseline=2.0, carrier=3e9)
MISALIGNED = partial(INTERFEROMETER, misalignment_sigma=1e-3)
SENSORS: dict[str, Callable[..., Sensor]] = {
    "bearing": partial(Bearing, sigma=3e-3),
    "bearing, uniform errors": partial(Bearing, sigma=3e-3, noise_law="uniform"),
    "Doppler": partial(Doppler, sigma=10.0, carrier=3e9),
    "Doppler, unknown carrier": partial(
        Doppler, sigma=10.0, carrier=5e4, carrier_sigma=1e4, carrier_walk=1.0, propagation_speed=1e5
    ),
    "radial acceleration": partial(RadialAcceleration, sigma=0.05),
    "phase forward": partial(INTERFEROMETER, axis=0),
    "phase starboard": partial(INTERFEROMETER, axis=1),
    "phase down": partial(INTERFEROMETER, axis=2),
    "phase forward, misaligned": partial(MISALIGNED, axis=0),
    "phase starboard, misaligned": partial(MISALIGNED, axis=1),
    "phase down, misaligned": partial(MISALIGNED, axis=2),
    "time difference": partial(TimeDifference, sigma=1e-7),
}
ARMS: dict[str, tuple[float, ...]] = {"centre": (), "lever arm": (40.0, -25.0, 7.0)}
NUISANCE_SCALES = {"carrier_offset": 1e3}
"""What counts as a usual value; a misalignment's is a milliradian."""

POSE = ("position", "velocity", "acceleration", "attitude", "attitude_rate")


def arms_of(sensor: Sensor, arm: tuple[float, ...]) -> dict[str, tuple[float, ...]]:
    """A value for each lever arm that the sensor has: the one given, and its reverse on another platform."""
    names = [field.name for field in dataclasses.fields(sensor) if field.name.endswith("lever_arm")]  # type: ignore[arg-type]
    return {name: arm if name == "lever_arm" else arm[::-1] for name in names}


class Case(NamedTuple):
    sensor: Sensor
    layout: StateLayout

    def poses(self, size: int) -> list[Pose]:
        """Two platforms 20 km apart: vessels at 200 m/s in turns of 3°/s, or bodies that tumble and accelerate."""
        spread = np.linspace(-1.0, 1.0, size)
        if self.layout.dimension == 2:
            velocity = 200.0 * np.stack([np.sin(spread), np.cos(spread)])
            first = PlanarPose(np.stack([500.0 + spread, -300.0 * spread]), velocity, spread, np.full(size, 0.05))
            other = np.stack([-9e3 + spread, 15e3 * np.ones(size)])
            return [first, PlanarPose(other, -velocity, spread + np.pi, np.full(size, -0.03))]
        return [tumbling((500.0, -300.0, 100.0), spread, 1), tumbling((-9e3, 15e3, 400.0), spread, 2)]

    def scales(self) -> np.ndarray:
        """The usual size of each nuisance."""
        return np.array([NUISANCE_SCALES.get(name, 1e-3) for name in self.layout.nuisance])

    def states(self, *shape: int, seed: int = 0) -> np.ndarray:
        """Emitters 20–60 km away in any direction, at 200 m/s, accelerating by 3 m/s²."""
        rng = np.random.default_rng(seed)
        d, states = self.layout.dimension, np.empty((self.layout.size, *shape))
        towards = rng.normal(size=(d, *shape))
        states[self.layout.position] = towards / np.linalg.norm(towards, axis=0) * rng.uniform(20e3, 60e3, shape)
        states[self.layout.velocity] = 120.0 * rng.normal(size=(d, *shape))
        states[self.layout.acceleration] = 3.0 * rng.normal(size=states[self.layout.acceleration].shape)
        nuisance = rng.normal(size=(len(self.layout.nuisance), *shape))
        states[self.layout.nuisances] = self.scales().reshape(-1, *(1,) * len(shape)) * nuisance
        return states

    def scene(self, states: np.ndarray) -> Scene:
        return Scene(states, self.layout, self.poses(states.shape[-1]))


def tumbling(place: tuple[float, ...], spread: np.ndarray, seed: int) -> Pose:
    """A body at 7 km/s whose attitude, turn rate and acceleration have nothing to do with where it goes."""
    rng = np.random.default_rng(seed)
    axes = np.stack([Rotation.from_rotvec([s, 0.3 * s + seed, -1.0]).as_matrix() for s in spread], axis=-1)
    spin = 0.05 * rng.normal(size=3)
    rate = np.cross(spin, np.moveaxis(axes, 1, -1))
    position = np.array(place)[:, None] + 300.0 * rng.normal(size=(3, 1)) * spread
    velocity, acceleration = rng.normal(size=(2, 3, 1)) * np.ones(len(spread))
    return Pose(position, 4e3 * velocity, 9.0 * acceleration, axes, np.moveaxis(rate, -1, 1))


def fits(sensor: Sensor, dimension: int) -> bool:
    try:
        sensor.check(dimension)
    except ScenarioError:
        return False
    return True


def _case(build: Callable[..., Sensor], arm: tuple[float, ...], dimension: int, order: int) -> Case:
    sensor = build(**arms_of(build(), arm[:dimension]))
    layout = StateLayout(dimension, order, tuple(nuisance.name for nuisance in sensor.nuisances))
    return Case(sensor, layout)


CASES = {
    f"{name}, {place}, {dimension}-D, order {order}": _case(build, arm, dimension, order)
    for name, build in SENSORS.items()
    for place, arm in ARMS.items()
    for dimension in (2, 3)
    for order in (1, 2)
    if fits(build(), dimension)
}


@pytest.fixture(params=CASES.values(), ids=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    found: Case = request.param
    return found


@pytest.mark.parametrize("name", SENSORS)
def test_every_sensor_is_tried_somewhere(name: str) -> None:
    assert sum(case.startswith(f"{name}, ") for case in CASES) >= 4


def test_jacobian_is_the_derivative(case: Case) -> None:
    """Central differences: curvature errs by (step/range)² ≈ 1e-8, rounding by 1e-16·|h|/(step·|h'|) ≈ 1e-10."""
    states = case.states(4, 20)
    jacobian = case.sensor.jacobian(case.scene(states))
    assert jacobian.shape == (case.sensor.size, *states.shape)
    sizes = np.full(case.layout.size, 2.0)
    sizes[case.layout.nuisances] = 2e-3 * case.scales()
    for row, size in enumerate(sizes):
        step = np.zeros_like(states)
        step[row] = size
        ahead, behind = (case.sensor.measure(case.scene(states + sign * step)) for sign in (1, -1))
        difference = SensorSuite((case.sensor,)).difference(ahead, behind) / (2.0 * size)
        scale = np.abs(jacobian[:, row]).max()
        np.testing.assert_allclose(jacobian[:, row], difference, rtol=1e-6, atol=1e-6 * scale + 1e-30)


def test_jacobian_predicts_every_small_step_of_a_circle(case: Case) -> None:
    """The emitter circles the platform once: differences never jump, and an angle adds up to its whole turn."""
    steps = 2000
    turn = np.linspace(0.0, 2.0 * np.pi, steps + 1)
    states = case.states(1)[:, :1] * np.ones(steps + 1)
    poses = [pose.mounted(case.sensor.lever_arm) for pose in case.poses(1)]
    radius = np.stack([30e3 * np.sin(turn), 30e3 * np.cos(turn)])
    states[:2] = poses[0].position[:2] + radius
    measured = case.sensor.measure(Scene(states, case.layout, case.poses(1)))
    jacobian = case.sensor.jacobian(Scene(states, case.layout, case.poses(1)))
    found = SensorSuite((case.sensor,)).difference(measured[:, 1:], measured[:, :-1])
    # The trapezium rule errs by (k · step angle)²/12 = 1e-5 for the fourth harmonic, the highest that matters here.
    slope = 0.5 * (jacobian[..., 1:] + jacobian[..., :-1])
    expected = np.einsum("mnN,nN->mN", slope, np.diff(states))
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    for row, angular in enumerate(case.sensor.angular):
        whole = 2.0 * np.pi if angular else 0.0
        assert found[row].sum() == pytest.approx(whole, abs=1e-9 * np.abs(measured).max())


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
    states, poses = case.states(300), case.poses(300)

    def both(states: np.ndarray, *values: np.ndarray) -> np.ndarray:
        rebuilt = [Pose(*values[: len(POSE)]), Pose(*values[len(POSE) :])]
        scene = Scene(states, case.layout, rebuilt)
        return np.concatenate([case.sensor.measure(scene), case.sensor.jacobian(scene)[0]])

    assert_batch_free(both, states, *(getattr(pose, name) for pose in poses for name in POSE))


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
    arms = arms_of(case.sensor, case.sensor.lever_arm)
    for pose, arm in zip(case.poses(3), arms.values(), strict=False):
        place = pose.mounted(arm)
        states = case.states(3)
        states[case.layout.position] = place.position
        states[case.layout.velocity, 1] = place.velocity[:, 1]
        assert np.isfinite(case.sensor.measure(case.scene(states))).all()
        assert np.isfinite(case.sensor.jacobian(case.scene(states))).all()


def test_only_relative_motion_counts(case: Case) -> None:
    """Shift and speed up emitter and platforms together: nothing changes. 1e6 m cost seven of sixteen digits."""
    states, poses, d = case.states(6), case.poses(6), case.layout.dimension
    shifted, push = states.copy(), np.array([2.0, -5.0, 1.0])[:d, None]
    shifted[case.layout.position] += 1e6
    shifted[case.layout.velocity] += 300.0
    shifted[case.layout.acceleration] += push[: len(states[case.layout.acceleration])]
    moved = [
        Pose(
            pose.position + 1e6,
            pose.velocity + 300.0,
            pose.acceleration + (push if case.layout.order > 1 else 0.0),
            pose.attitude,
            pose.attitude_rate,
        )
        for pose in poses
    ]
    measured = case.sensor.measure(Scene(states, case.layout, poses))
    found = case.sensor.measure(Scene(shifted, case.layout, moved))
    np.testing.assert_allclose(found, measured, rtol=1e-7, atol=1e-7 * np.abs(measured).max())


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("bearing", []),
        ("Doppler", []),
        ("Doppler, unknown carrier", [("carrier_offset", 1e4, 1.0)]),
        ("radial acceleration", []),
        ("phase forward", []),
        ("phase forward, misaligned", [(f"{turn}_error_0", 1e-3, 0.0) for turn in ("roll", "pitch", "yaw")]),
        ("time difference", []),
    ],
)
def test_nuisances_are_declared(name: str, expected: list[tuple[str, float, float]]) -> None:
    found = nuisances((SENSORS[name](),))
    assert [(nuisance.name, nuisance.sigma, nuisance.walk) for nuisance in found] == expected


@pytest.mark.parametrize("name", SENSORS)
def test_platforms_are_named(name: str) -> None:
    """A sensor says which platforms it needs, its own first: what hides the emitter from one of them silences it."""
    expected = (0, 1) if name == "time difference" else (0,)
    assert SENSORS[name]().platforms == expected
