"""The Earth and turning bodies: against pymap3d, SciPy's rotations and brute force."""

from collections.abc import Callable

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from passloc_env import frames

SIZE = 400
EQUATORIAL, POLAR = 6_378_137.0, 6_356_752.314245
"""Axes of WGS-84, m."""


def places(size: int = SIZE, low: float = -1e3, high: float = 2e6, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Latitude, longitude and height, evenly over the globe."""
    rng = np.random.default_rng(seed)
    return np.arcsin(rng.uniform(-1, 1, size)), rng.uniform(-np.pi, np.pi, size), rng.uniform(low, high, size)


def above_ground(size: int = SIZE, seed: int = 0, low: float = 300e3) -> np.ndarray:
    """Positions of satellites ``(3, N)``."""
    return np.array(pymap3d.geodetic2ecef(*places(size, low, 2e6, seed), deg=False))


def level(position: np.ndarray) -> np.ndarray:
    """Below one inside the ellipsoid, above one outside."""
    value: np.ndarray = (position[0] ** 2 + position[1] ** 2) / EQUATORIAL**2 + position[2] ** 2 / POLAR**2
    return value


# Places.


def test_places_are_those_of_pymap3d_and_come_back() -> None:
    latitude, longitude, height = places()
    position = frames.from_geodetic(latitude, longitude, height)
    np.testing.assert_array_equal(position, pymap3d.geodetic2ecef(latitude, longitude, height, deg=False))
    found = frames.geodetic(position)
    # Rounding of 7e6 m; pymap3d's closed form is good to 1e-8 m and 2e-9 rad (1 cm).
    np.testing.assert_allclose(found.height, height, atol=1e-7)
    np.testing.assert_allclose(found.latitude, latitude, atol=3e-9)
    np.testing.assert_allclose(found.longitude, longitude, atol=1e-12)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_shapes_keep_the_batch(size: int) -> None:
    position = above_ground(size)
    towards = -position / np.linalg.norm(position, axis=0)
    assert [value.shape for value in frames.geodetic(position)] == [(size,)] * 3
    fix = frames.meet_height(position, towards, 0.0)
    assert (fix.position.shape, fix.hit.shape, fix.normal.shape) == ((3, size), (size,), (3, size))
    assert frames.course(position, towards).shape == (size,)
    assert frames.below_horizon(position, 0.5 * position).shape == (size,)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_poles_are_places(sign: float) -> None:
    position = np.array([[0.0], [0.0], [sign * (POLAR + 5e3)]])
    found = frames.geodetic(position)
    assert float(np.squeeze(found.latitude)) == pytest.approx(sign * np.pi / 2)
    np.testing.assert_allclose(found.height, 5e3, atol=1e-6)
    there = frames.from_geodetic(np.array([sign * np.pi / 2]), np.zeros(1), np.full(1, 5e3))
    np.testing.assert_allclose(there, position, atol=1e-6)


def test_local_axes_are_those_of_pymap3d() -> None:
    latitude, longitude, height = places()
    axes = frames.local_axes(latitude, longitude)
    for axis, enu in enumerate(np.eye(3)):
        expected = pymap3d.enu2uvw(*enu, np.degrees(latitude), np.degrees(longitude))
        np.testing.assert_allclose(axes[axis], expected, atol=1e-14)
    # Up is where the height grows: by a metre per metre.
    position = frames.from_geodetic(latitude, longitude, height)
    np.testing.assert_allclose(frames.geodetic(position + 100.0 * axes[2]).height - height, 100.0, atol=1e-6)


def test_course_is_where_the_ground_track_goes() -> None:
    """Against the displacement after 10 ms, as pymap3d sees it from the start; 2 m rounded to 1e-9 m."""
    latitude, longitude, height = places(high=2e4)
    position = frames.from_geodetic(latitude, longitude, height)
    velocity = 200.0 * np.random.default_rng(1).normal(size=position.shape)
    moved = position + 0.01 * velocity
    east, north, _ = pymap3d.ecef2enu(*moved, latitude, longitude, height, deg=False)
    difference = frames.course(position, velocity) - np.arctan2(east, north)
    level_speed = np.hypot(east, north) / 0.01
    np.testing.assert_allclose(np.sin(difference) * level_speed, 0.0, atol=1e-5)
    assert (np.cos(difference) > 0.0).all()


def test_course_by_hand() -> None:
    """On the equator at longitude 90°: north is the Earth's axis, east is −x."""
    position = np.repeat([[0.0], [EQUATORIAL], [0.0]], 4, axis=1)
    velocity = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [1.0, 5.0, 1.0]]).T
    np.testing.assert_allclose(np.degrees(frames.course(position, velocity)), [0.0, 90.0, 180.0, -45.0], atol=1e-9)


# Lines of sight.


@pytest.mark.parametrize("height", [-500.0, 0.0, 10e3, "random"])
def test_lines_meet_a_height_at_the_nearer_point(height: float | str) -> None:
    """Aimed at places of that height: those that face the satellite are found, for others the point before them."""
    origin = above_ground()
    latitude, longitude, heights = places(seed=1, high=20e3)
    heights = heights if height == "random" else np.full(SIZE, float(height))
    aim = frames.from_geodetic(latitude, longitude, heights)
    away = np.linalg.norm(aim - origin, axis=0)
    towards = (aim - origin) / away
    fix = frames.meet_height(origin, towards, heights)
    assert fix.hit.all()
    np.testing.assert_allclose(pymap3d.ecef2geodetic(*fix.position, deg=False)[2], heights, atol=1e-6)
    # On the line, before the satellite, and never behind what was aimed at.
    along = np.einsum("in,in->n", fix.position - origin, towards)
    np.testing.assert_allclose(fix.position, origin + along * towards, atol=1e-6)
    assert (along > 0.0).all()
    assert (along <= away + 1e-3).all()
    up = frames.local_axes(latitude, longitude)[2]
    facing = np.einsum("in,in->n", up, towards) < -1e-3
    np.testing.assert_allclose(fix.position[:, facing], aim[:, facing], atol=1e-3)
    assert (along[~facing] < away[~facing] - 1e3).sum() > 0.9 * (~facing).sum() > 50
    # The line comes from outside: against the gradient of the height, which is where that grows fastest.
    place = pymap3d.ecef2geodetic(*fix.position, deg=False)
    np.testing.assert_allclose(fix.normal, frames.local_axes(*place[:2])[2], atol=1e-12)
    assert (np.einsum("in,in->n", fix.normal, towards) < 0.0).all()


def test_lines_that_miss_are_flagged_and_finite() -> None:
    """They pass a kilometre or more above the height, or point away: the fix is their point nearest to the centre."""
    origin = above_ground()
    rng = np.random.default_rng(2)
    radius = np.linalg.norm(origin, axis=0)
    sideways = np.cross(origin.T, rng.normal(size=(SIZE, 3))).T
    sideways /= np.linalg.norm(sideways, axis=0)
    passes = rng.uniform(EQUATORIAL + 11e3, 0.99 * radius)
    sine = passes / radius
    towards = sine * sideways - np.sqrt(1.0 - sine**2) * origin / radius
    towards[:, ::4] = origin[:, ::4] / radius[::4]
    fix = frames.meet_height(origin, towards, 10e3)
    assert not fix.hit.any()
    assert np.isfinite(fix.position).all()
    np.testing.assert_allclose(np.linalg.norm(fix.normal, axis=0), 1.0, rtol=1e-12)
    nearest = np.where(np.arange(SIZE) % 4 == 0, radius, passes)
    np.testing.assert_allclose(np.linalg.norm(fix.position, axis=0), nearest, rtol=1e-9)
    np.testing.assert_allclose(np.cross((fix.position - origin).T, towards.T), 0.0, atol=1e-6)


def test_hits_and_misses_side_by_side_do_not_touch_each_other() -> None:
    origin = np.repeat([[7.1e6], [0.0], [0.0]], 3, axis=1)
    towards = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]).T
    fix = frames.meet_height(origin, towards, 0.0)
    assert fix.hit.tolist() == [True, False, True]
    np.testing.assert_allclose(fix.position[0], [EQUATORIAL, 7.1e6, EQUATORIAL], atol=1e-6)


@pytest.mark.parametrize("highest", [0.0, 20e3, 900e3])
def test_horizon_against_sampling_the_line(highest: float) -> None:
    """4000 points on each line; lines that graze by less than the sampling resolves, 4 m, are left out."""
    size = 3000
    observer = above_ground(size)
    # Within two thousand kilometres of the point below, where seen and hidden are both common, or anywhere.
    latitude, longitude, _ = places(size, seed=3)
    place = pymap3d.ecef2geodetic(*observer, deg=False)
    near = np.arange(size) % 4 > 0
    rng = np.random.default_rng(4)
    latitude[near] = np.clip(place[0] + 0.7 * rng.uniform(-1, 1, size), -1.5, 1.5)[near]
    longitude[near] = (place[1] + 0.7 * rng.uniform(-1, 1, size))[near]
    point = frames.from_geodetic(latitude, longitude, rng.uniform(0.0, highest, size) + 1e-3)
    share = np.linspace(0.0, 1.0, 4000)
    lines = zip(observer.T[..., None], point.T[..., None], strict=True)
    lowest = np.array([level(start + share * (end - start)).min() for start, end in lines])
    clear = np.abs(lowest - 1.0) > 8.0 / EQUATORIAL
    # A line that only touches the ground at its end is as low as its end: clear by less than 4 m, but not hidden.
    clear |= lowest == level(point)
    hidden = frames.below_horizon(observer, point)
    np.testing.assert_array_equal(hidden[clear], (lowest < 1.0)[clear])
    assert 0.1 < hidden.mean() < 0.9
    assert clear.mean() > 0.98


def test_an_emitter_in_a_depression_is_seen_from_above() -> None:
    """Ground below the ellipsoid hides nothing by itself: only what lies on the way does."""
    observer = frames.from_geodetic(*np.array([[0.5], [0.6], [700e3]]))
    for offset, expected in ((0.0, False), (0.2, False), (2.0, True)):
        point = frames.from_geodetic(*np.array([[0.5], [0.6 + offset], [-430.0]]))
        assert frames.below_horizon(observer, point).tolist() == [expected]


def test_nothing_hides_what_is_here() -> None:
    observer = above_ground(5)
    assert not frames.below_horizon(observer, observer).any()


# Bodies.


def test_bodies_turn_like_scipys_rotations() -> None:
    """About their own axes: from the smallest angles through half and whole turns."""
    rng = np.random.default_rng(5)
    bodies = Rotation.random(SIZE, random_state=1)
    axes = np.moveaxis(bodies.as_matrix(), 0, -1)
    rotation = rng.normal(size=(3, SIZE)) * 10.0 ** rng.uniform(-12.0, 1.0, SIZE)
    rotation[:, :3] = 0.0
    turned = frames.turned_body(axes, rotation)
    for column, (body, angles) in enumerate(zip(bodies, rotation.T, strict=True)):
        matrix = body.as_matrix()
        expected = Rotation.from_rotvec(matrix.T @ angles).apply(matrix)
        np.testing.assert_allclose(turned[..., column], expected, atol=1e-13)
    np.testing.assert_array_equal(turned[..., :3], axes[..., :3])


def test_positive_rates_roll_pitch_and_yaw_to_starboard_up_and_starboard() -> None:
    """Forward, starboard, down as rows; a right-handed roll lowers starboard, a pitch lifts the nose."""
    level_body = np.repeat(np.eye(3)[..., None], 3, axis=-1)
    turned = frames.turned_body(level_body, 0.1 * np.eye(3))
    assert turned[1, 2, 0] == pytest.approx(np.sin(0.1))
    assert turned[0, 2, 1] == pytest.approx(-np.sin(0.1))
    assert turned[0, 1, 2] == pytest.approx(np.sin(0.1))


def test_cross_is_numpys() -> None:
    a, b = np.random.default_rng(6).normal(size=(2, 3, 4, SIZE))
    np.testing.assert_allclose(frames.cross(a, b), np.cross(a, b, axis=0), rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize(
    "function",
    [
        lambda a, b: np.stack([np.ravel(value) for value in frames.geodetic(a)]),
        lambda a, b: np.concatenate([(fix := frames.meet_height(a, b, 10e3)).position, fix.normal, fix.hit[None]]),
        lambda a, b: frames.course(a, b),
        lambda a, b: frames.below_horizon(a, 5e6 * b),
        lambda a, b: frames.turned_body(np.moveaxis(np.stack([a, b, a]), 0, 1), b),
        lambda a, b: frames.local_axes(b[0], b[1]),
        lambda a, b: frames.from_geodetic(b[0], b[1], b[2]),
    ],
    ids=["geodetic", "meet height", "course", "horizon", "turned body", "local axes", "from geodetic"],
)
def test_bits_do_not_depend_on_the_batch(
    function: Callable[..., np.ndarray], assert_batch_free: Callable[..., None]
) -> None:
    towards = np.random.default_rng(7).normal(size=(3, 300))
    assert_batch_free(function, above_ground(300), towards / np.linalg.norm(towards, axis=0))


@pytest.mark.parametrize("height", [10e3, 1e3])
@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_from_below_no_line_comes_down_to_a_height(height: float, towards: float) -> None:
    """At 500 m, looking up or down: the point is never behind the origin."""
    origin = np.array([[frames.EARTH_RADIUS + 500.0], [0.0], [0.0]])
    line = np.array([[towards], [0.0], [0.0]])
    fix = frames.meet_height(origin, line, height)
    assert not fix.hit.any()
    assert (fix.position - origin)[0, 0] * towards >= 0.0
