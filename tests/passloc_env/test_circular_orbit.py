"""Satellites: celestial mechanics against SciPy, attitude against finite differences, and what they report of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from passloc_env.errors import ScenarioError
from passloc_env.frames import EARTH_GRAVITY, EARTH_RADIUS, EARTH_RATE
from passloc_env.noise import NavigationErrors
from passloc_env.platforms import CircularOrbit, Pose
from passloc_env.scenario import Scenario
from passloc_env.sensors import PhaseDifference, TimeDifference
from passloc_env.simulation import Simulation
from passloc_env.target import GeodeticStart, Target
from passloc_env.tracking import ExtendedKalman, StatePrior

ORBIT = CircularOrbit(altitude=700e3, inclination=1.1, argument_of_latitude=0.6, node_longitude=-2.0)
AGILE = replace(ORBIT, max_body_rate=0.03)
SIZE = 3
RATES = np.array([[0.01, -0.03, 0.0], [0.02, 0.005, 0.0], [-0.03, 0.0, 0.001]])
"""Body rates ``(3, N)`` of three satellites."""

EARTH_SPIN = np.array([0.0, 0.0, EARTH_RATE])
FALSE_ALARM = 1e-3


def inertial(pose: Pose, time: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity ``(3, N)`` in the frame that coincides with the Earth's at time zero."""
    turn = Rotation.from_rotvec(EARTH_SPIN * time).as_matrix()
    return turn @ pose.position, turn @ (pose.velocity + np.cross(EARTH_SPIN, pose.position.T).T)


def tumbled(orbit: CircularOrbit = AGILE) -> np.ndarray:
    """Three satellites on their way, their bodies turned and turning at :data:`RATES`."""
    state = orbit.start(SIZE)
    state[0] += np.array([0.0, 1.3, 4.0])
    state[1] += np.array([0.0, -0.5, 2.0])
    return orbit.move(state, RATES, 25.0)


# Motion.


@pytest.mark.parametrize("orbit", [ORBIT, AGILE], ids=["nadir", "agile"])
def test_every_rate_is_the_derivative_of_what_it_says(orbit: CircularOrbit) -> None:
    """Central differences over ± 50 ms err by step² ω²/6 = 4e-7 of the value for a body at ω = 0.03 rad/s.

    Rounding of 7e6 m costs 1e-9 m / 0.1 s = 1e-8 m/s.
    """
    step, state = 0.05, tumbled(orbit) if orbit is AGILE else orbit.move(orbit.start(SIZE), np.zeros((3, SIZE)), 900.0)
    now = orbit.pose(state)
    before, after = (orbit.pose(orbit.move(state, RATES, sign * step)) for sign in (-1.0, 1.0))
    for value, slope, rtol, atol in (
        ("position", "velocity", 1e-8, 1e-7),
        ("velocity", "acceleration", 1e-7, 1e-9),
        ("attitude", "attitude_rate", 1e-6, 1e-8),
    ):
        difference = (getattr(after, value) - getattr(before, value)) / (2.0 * step)
        np.testing.assert_allclose(difference, getattr(now, slope), rtol=rtol, atol=atol)
    if orbit is AGILE:
        assert np.abs(now.attitude_rate).max() > 0.02


def test_radius_speed_and_energy() -> None:
    radius = EARTH_RADIUS + 700e3
    for time in (0.0, 1234.0):
        position, velocity = inertial(ORBIT.pose(ORBIT.move(ORBIT.start(1), np.zeros((3, 1)), time)), time)
        assert np.linalg.norm(position) == pytest.approx(radius, rel=1e-14)
        energy = 0.5 * np.linalg.norm(velocity) ** 2 - EARTH_GRAVITY / np.linalg.norm(position)
        assert energy == pytest.approx(-0.5 * EARTH_GRAVITY / radius, rel=1e-12)
        momentum = np.cross(position[:, 0], velocity[:, 0])
        node = -2.0
        tilt = [np.sin(1.1) * np.sin(node), -np.sin(1.1) * np.cos(node), np.cos(1.1)]
        np.testing.assert_allclose(momentum / np.linalg.norm(momentum), tilt, atol=1e-12)


def test_period_is_keplers() -> None:
    """After 2π √(a³/μ), 98.8 minutes at 700 km, it is back, while the Earth has turned on."""
    period = 2.0 * np.pi * np.sqrt((EARTH_RADIUS + 700e3) ** 3 / EARTH_GRAVITY)
    assert period / 60.0 == pytest.approx(98.77, abs=0.01)
    start = ORBIT.start(1)
    there = inertial(ORBIT.pose(ORBIT.move(start, np.zeros((3, 1)), period)), period)[0]
    np.testing.assert_allclose(there, inertial(ORBIT.pose(start))[0], atol=1e-6)


def test_it_starts_at_its_node_and_goes_north() -> None:
    orbit = CircularOrbit(inclination=0.9, node_longitude=0.5 * np.pi)
    position, velocity = inertial(orbit.pose(orbit.start(1)))
    np.testing.assert_allclose(position[:, 0], [0.0, EARTH_RADIUS + 700e3, 0.0], atol=1e-6)
    speed = np.linalg.norm(velocity)
    np.testing.assert_allclose(velocity[:, 0] / speed, [-np.cos(0.9), 0.0, np.sin(0.9)], atol=1e-12)


def test_motion_is_that_of_a_body_under_gravity() -> None:
    """Against the two-body problem integrated in the inertial frame, turned by the Earth's rate: half a day.

    The integration is good to its 1e-12 per step, which seven orbits let grow to 1e-10 of 7e6 m.
    """
    start = ORBIT.start(1)
    position, velocity = inertial(ORBIT.pose(start))

    def fall(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], -EARTH_GRAVITY * y[:3] / np.linalg.norm(y[:3]) ** 3])

    times = np.linspace(0.0, 12.0 * 3600.0, 7)
    flown = solve_ivp(
        fall, (0.0, times[-1]), [*position[:, 0], *velocity[:, 0]], "DOP853", times, rtol=1e-13, atol=1e-6
    )
    for time, expected in zip(times, flown.y.T, strict=True):
        found = inertial(ORBIT.pose(ORBIT.move(start, np.zeros((3, 1)), time)), time)
        np.testing.assert_allclose(found[0][:, 0], expected[:3], atol=1e-2)
        np.testing.assert_allclose(found[1][:, 0], expected[3:], atol=1e-5)


def test_steps_of_any_length_lead_to_the_same_place() -> None:
    coarse, fine = tumbled(), tumbled()
    coarse = AGILE.move(coarse, RATES, 30.0)
    for _ in range(300):
        fine = AGILE.move(fine, RATES, 0.1)
    np.testing.assert_allclose(fine, coarse, atol=1e-12)


# Attitude.


def test_the_body_starts_with_the_orbit() -> None:
    """Down to the Earth's centre, forward along the inertial velocity, starboard to the right of it."""
    state = ORBIT.move(ORBIT.start(SIZE), RATES, 500.0)
    pose = ORBIT.pose(state)
    _, velocity = inertial(pose)
    forward, starboard, down = pose.attitude
    np.testing.assert_allclose(down, -pose.position / np.linalg.norm(pose.position, axis=0), atol=1e-14)
    np.testing.assert_allclose(forward, velocity / np.linalg.norm(velocity, axis=0), atol=1e-12)
    np.testing.assert_allclose(starboard, np.cross(down.T, forward.T).T, atol=1e-12)


def test_attitude_stays_orthonormal_over_ten_thousand_steps() -> None:
    rng = np.random.default_rng(0)
    state = AGILE.start(SIZE)
    for _ in range(10_000):
        state = AGILE.move(state, AGILE.set_point(state, rng.uniform(-1, 1, (3, SIZE)), state[:3]), 1.0)
    axes = np.moveaxis(AGILE.pose(state).attitude, -1, 0)
    # Each step rounds to 1e-16; ten thousand of them add up to 1e-14 like a random walk, to 1e-12 at worst.
    np.testing.assert_allclose(axes @ axes.swapaxes(1, 2), np.repeat(np.eye(3)[None], SIZE, axis=0), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=1e-12)


def test_body_rates_turn_the_body_in_its_orbit() -> None:
    """Against SciPy: orbital axes first, then the rotation vector along the body axes."""
    state = AGILE.start(SIZE)
    moved = AGILE.move(state, RATES, 20.0)
    still = ORBIT.pose(ORBIT.move(state, RATES, 20.0)).attitude
    turned = AGILE.pose(moved).attitude
    for column in range(SIZE):
        orbital = still[..., column]
        expected = Rotation.from_rotvec(orbital.T @ (20.0 * RATES[:, column])).apply(orbital)
        np.testing.assert_allclose(turned[..., column], expected, atol=1e-13)


def test_commands_are_shares_of_the_largest_rate() -> None:
    state, action = AGILE.start(2), np.array([[1.0, 0.0], [-1.0, 0.5], [0.0, 0.0]])
    np.testing.assert_allclose(AGILE.set_point(state, action, state[:3]), 0.03 * action)
    assert (AGILE.controls, ORBIT.controls, AGILE.steers_body, ORBIT.steers_body) == (3, 0, True, False)
    assert AGILE.dimension == 3


# What is reported.

WHITE = replace(AGILE, attitude_sigma=2e-3)
BIASED = replace(AGILE, attitude_bias_sigma=5e-3)
BOTH = replace(AGILE, attitude_sigma=2e-3, attitude_bias_sigma=5e-3)


def error_angles(true: Pose, reported: Pose) -> np.ndarray:
    """Rotation vectors ``(3, N)`` along the true body axes that lead to the reported attitude."""
    found = []
    for axes, seen in zip(np.moveaxis(true.attitude, -1, 0), np.moveaxis(reported.attitude, -1, 0), strict=True):
        # The rows of both are body axes: R b_i = b'_i.
        found.append(axes @ Rotation.from_matrix(seen.T @ axes).as_rotvec())
    return np.array(found).T


@pytest.mark.parametrize(
    ("orbit", "constant", "fresh"), [(WHITE, 0, 3), (BIASED, 3, 0), (BOTH, 3, 3)], ids=["white", "constant", "both"]
)
def test_the_reported_attitude_is_turned_by_the_errors(orbit: CircularOrbit, constant: int, fresh: int) -> None:
    assert (orbit.constant_errors, orbit.fresh_errors) == (constant, fresh)
    rng, state = np.random.default_rng(1), tumbled()
    errors = NavigationErrors(rng.standard_normal((constant, SIZE)), rng.standard_normal((fresh, SIZE)))
    true = orbit.pose(state)
    reported = orbit.reported_pose(state, true, errors)
    expected = np.zeros((3, SIZE))
    expected += 5e-3 * errors.constant if constant else 0.0
    expected += 2e-3 * errors.fresh if fresh else 0.0
    np.testing.assert_allclose(error_angles(true, reported), expected, atol=1e-14)
    for name in ("position", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(reported, name), getattr(true, name))


def test_without_errors_the_truth_is_reported() -> None:
    state = tumbled()
    true = AGILE.pose(state)
    assert AGILE.reported_pose(state, true, NavigationErrors(*np.zeros((2, 0, SIZE)))) is true
    assert (AGILE.constant_errors, AGILE.fresh_errors) == (0, 0)


def test_errors_have_their_sigma_about_every_axis() -> None:
    """5000 draws per axis against the normal law; six tests, one seed in 170 fails one of them by chance."""
    rng, size = np.random.default_rng(2), 5000
    state = AGILE.start(size)
    for orbit, sigma in ((WHITE, 2e-3), (BIASED, 5e-3)):
        normals = rng.standard_normal((3, size))
        errors = NavigationErrors(normals[: orbit.constant_errors], normals[: orbit.fresh_errors])
        true = orbit.pose(state)
        for angles in error_angles(true, orbit.reported_pose(state, true, errors)):
            assert stats.kstest(angles / sigma, "norm").pvalue > FALSE_ALARM


@pytest.mark.parametrize("orbit", [ORBIT, BOTH], ids=["nadir", "agile with errors"])
def test_joined_poses_are_the_pose_of_the_joined_state(orbit: CircularOrbit) -> None:
    state = tumbled(orbit) if orbit.controls else orbit.start(SIZE)
    pose = orbit.pose(state)
    joined = type(pose).join([pose, orbit.pose(state + 0.01)])
    whole = orbit.pose(np.concatenate([state, state + 0.01], axis=-1))
    for name in ("position", "velocity", "acceleration", "attitude", "attitude_rate"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    rng = np.random.default_rng(3)
    state = BOTH.start(300) + 0.1 * rng.standard_normal((14, 300))

    def fly(state: np.ndarray, action: np.ndarray, constant: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        moved = BOTH.move(state, BOTH.set_point(state, action, state[:3]), 4.0)
        reported = BOTH.reported_pose(moved, BOTH.pose(moved), NavigationErrors(constant, fresh)).mounted(
            (1.0, 2.0, 3.0)
        )
        return np.concatenate([moved, reported.position, reported.velocity, reported.acceleration])

    assert_batch_free(fly, state, rng.uniform(-1, 1, (3, 300)), *rng.standard_normal((2, 3, 300)))


@pytest.mark.parametrize(
    "fields", [{"altitude": 90e3}, {"inclination": -0.1}, {"max_body_rate": -1.0}, {"attitude_sigma": -1e-3}]
)
def test_impossible_orbits(fields: dict[str, float], refusal: Callable[..., ScenarioError]) -> None:
    assert refusal(lambda: CircularOrbit(**fields)).field == next(iter(fields))


# In the simulation.

INTERFEROMETER = PhaseDifference(sigma=0.1, baseline=1.0, carrier=1e9)
SATELLITES = Scenario(
    name="two satellites",
    target=Target(start=GeodeticStart(latitude=0.0, longitude=0.1, height=5e3, speed=200.0, course=1.0)),
    platforms=(CircularOrbit(inclination=0.0), CircularOrbit(inclination=0.0, argument_of_latitude=-0.4)),
    sensors=(INTERFEROMETER, replace(INTERFEROMETER, platform=1), TimeDifference(sigma=1e-7)),
    prior=StatePrior(position_sigma=1e4, velocity_sigma=100.0),
    tracker=ExtendedKalman(),
).override({"episode.steps": 40, "episode.min_range": 0.0, "episode.decision_every": 1})


def watched(simulation: Simulation) -> list[np.ndarray | None]:
    """What was detected at each step from now on; the tracker gets the same."""
    simulation.straight = False
    masks: list[np.ndarray | None] = []
    update = simulation.track.update

    def listen(measurement: np.ndarray, poses: list[Pose], detected: np.ndarray | None = None) -> None:
        masks.append(detected)
        update(measurement, poses, detected)

    simulation.track.update = listen  # type: ignore[method-assign]
    return masks


def assert_finite(simulation: Simulation) -> None:
    for name, values in simulation.state_arrays().items():
        assert np.isfinite(values).all(), name
    assert np.isfinite(simulation.observe()).all()


def test_an_emitter_below_the_horizon_is_not_heard(begin: Callable[..., Simulation]) -> None:
    """On the far side of the Earth: the belief is the prediction to the last bit, and nothing is learnt."""
    simulation = begin(SATELLITES.override({"target.start.longitude": 3.0}), 2)
    masks, period = watched(simulation), SATELLITES.episode.period
    for step in range(5):
        dynamics = simulation.models.tracker.dynamics
        mean, covariance = simulation.track.mean.copy(), simulation.track.covariance.copy()
        dynamics.advance(mean, np.full(2, step * period))
        dynamics.spread(covariance)
        simulation.step(np.zeros((0, 2)))
        np.testing.assert_array_equal(simulation.track.mean, mean)
        np.testing.assert_array_equal(simulation.track.covariance, covariance)
        assert not simulation.track.nis.any()
        assert not simulation.information.gram_gain.any()
        assert_finite(simulation)
    assert all(mask is not None and not mask.any() for mask in masks)
    assert not simulation.track.repairs.any()


def test_each_satellite_has_its_own_horizon(begin: Callable[..., Simulation]) -> None:
    """In sight of the first alone: its phase is measured, the other's is not, and a time difference takes both."""
    simulation = begin(SATELLITES, 2)
    masks = watched(simulation)
    simulation.step(np.zeros((0, 2)))
    assert masks[0] is not None
    np.testing.assert_array_equal(masks[0], [[True] * 2, [False] * 2, [False] * 2])
    assert_finite(simulation)


def test_an_emitter_sets_when_its_elevation_is_zero(begin: Callable[..., Simulation]) -> None:
    """One satellite flies away; the angle at the Earth's centre at which it sets is arccos of a/r, on a round Earth.

    On the equator, seen from above it, the Earth is round. 5 km of height make it visible a little longer.
    """
    scenario = SATELLITES.override({"target.start.speed": 0.0, "episode.period": 30.0})
    simulation = begin(scenario, 1)
    radius, height = EARTH_RADIUS + 700e3, 5e3
    limit = np.arccos(EARTH_RADIUS / radius) + np.arccos(EARTH_RADIUS / (EARTH_RADIUS + height))
    masks, expected = watched(simulation), []
    for _ in range(20):
        simulation.step(np.zeros((0, 1)))
        satellite, emitter = simulation.poses()[0].position[:, 0], simulation.truth[:3, 0]
        cosine = satellite @ emitter / np.linalg.norm(satellite) / np.linalg.norm(emitter)
        expected.append(np.arccos(cosine) < limit)
    found = [mask is None or bool(mask[0, 0]) for mask in masks]
    assert found == expected
    assert True in found
    assert False in found
    assert_finite(simulation)


def test_attitude_errors_stay_or_come_anew(begin: Callable[..., Simulation]) -> None:
    """A constant error is the same at every step of an episode and another in the next; a white one never is."""
    biased = CircularOrbit(inclination=0.0, max_body_rate=0.02, attitude_bias_sigma=5e-3)
    white = CircularOrbit(inclination=0.0, attitude_sigma=2e-3)
    simulation = begin(SATELLITES.replace(platforms=(biased, white)), SIZE)
    rng, seen = np.random.default_rng(4), []
    for _ in range(2):
        for _ in range(4):
            simulation.step(rng.uniform(-1, 1, (3, SIZE)))
            true = simulation.poses()
            seen.append([error_angles(*pair) for pair in zip(true, simulation.belief.poses, strict=True)])
        simulation.reset(np.arange(SIZE), [rng] * SIZE)
    constant, fresh = np.array(seen).swapaxes(0, 1)
    np.testing.assert_allclose(constant[:4], np.repeat(constant[:1], 4, axis=0), atol=1e-12)
    np.testing.assert_allclose(constant[4:], np.repeat(constant[4:5], 4, axis=0), atol=1e-12)
    assert len(np.unique(constant[[0, 4]].round(9))) == 2 * 3 * SIZE
    assert len(np.unique(fresh.round(9))) == fresh.size
    assert 2e-3 < np.abs(constant).max() < 5 * 5e-3
    assert 5e-4 < np.abs(fresh).max() < 5 * 2e-3


def test_what_is_measured_comes_from_the_true_attitude(begin: Callable[..., Simulation]) -> None:
    """The world measures the same whatever the satellites report; tracker and agent do not know the errors."""
    plain = begin(SATELLITES, 2)
    misread = begin(
        SATELLITES.override({"platforms.0.attitude_bias_sigma": 0.01, "platforms.1.attitude_sigma": 0.01}), 2
    )
    for simulation in (plain, misread):
        simulation.step(np.zeros((0, 2)))
    for ours, theirs in zip(plain.measure(plain.scene()), misread.measure(misread.scene()), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert np.abs(plain.track.mean - misread.track.mean).max() > 1.0
    np.testing.assert_array_equal(plain.information.bound, misread.information.bound)


@pytest.mark.parametrize("inclination", [0.3, 1.1, 1.57, 2.5])
def test_the_state_of_a_pose(inclination: float) -> None:
    """The orbit and the body go on as before; angles of 7000 km tell 1e-9 from a millimetre."""
    orbit = replace(AGILE, inclination=inclination)
    state = tumbled(orbit)
    again = orbit.state_at(orbit.pose(state))
    held = -RATES
    for _ in range(3):
        ours, theirs = (orbit.pose(one) for one in (again, state))
        for name, tolerance in (("position", 1e-2), ("velocity", 1e-5), ("attitude", 1e-9)):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=0.0, atol=tolerance)
        again, state = orbit.move(again, held, 7.0), orbit.move(state, held, 7.0)
    np.testing.assert_array_equal(again[11:], state[11:])
