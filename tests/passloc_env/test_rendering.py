"""Pictures show what they say: the right things, in the right colours, at the right places."""

import copy
import os

import gymnasium
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from passloc_env import SCENARIOS, LocalisationEnv, LocalisationVectorEnv
from passloc_env.errors import NotResetError, RenderError, ScenarioError
from passloc_env.frames import from_geodetic
from passloc_env.rendering import canvas as canvases
from passloc_env.rendering.canvas import Canvas
from passloc_env.rendering.colours import EMITTER, ESTIMATE, OBSERVER
from passloc_env.rendering.frame import SIZE
from passloc_env.rendering.map_panel import ellipse
from passloc_env.rendering.plane import Plane
from passloc_env.rendering.record import Instant, Recorder
from passloc_env.rendering.renderer import Renderer
from passloc_env.rendering.viewport import Viewport, in_words, nice, round_down

pytest.importorskip("pygame")


def rgb(colour: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(colour[1:]))


def pixels_of(picture: np.ndarray, colour: str) -> int:
    return int((picture == rgb(colour)).all(axis=-1).sum())


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_is_shown(name: str) -> None:
    env = gymnasium.make(f"passloc/{name}-v0", render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    for _ in range(3):
        env.step(env.action_space.sample())
    last = env.render()
    for picture in (first, last):
        assert (picture.shape, picture.dtype) == ((SIZE, SIZE, 3), np.uint8)
        for colour in (OBSERVER, EMITTER, ESTIMATE):
            assert pixels_of(picture, colour) > 20
    assert (first != last).any()
    env.close()


def test_rendering_changes_no_episode() -> None:
    shown, plain = (LocalisationEnv("BearingDoppler", render_mode=mode) for mode in ("rgb_array", None))
    for env in (shown, plain):
        env.reset(seed=3)
    for _ in range(5):
        action = np.array([0.3], np.float32)
        mine, other = shown.step(action), plain.step(action)
        shown.render()
        np.testing.assert_array_equal(mine[0], other[0])
        assert mine[1:] == other[1:]
    assert plain.render() is None


def test_a_copy_is_shown_as_well() -> None:
    env = LocalisationEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.zeros(1, np.float32))
    twin = copy.deepcopy(env)
    for each in (env, twin):
        each.step(np.full(1, 0.5, np.float32))
    np.testing.assert_array_equal(twin.render(), env.render())


def test_a_vector_environment_shows_its_first_ones() -> None:
    env = LocalisationVectorEnv(20, render_mode="rgb_array")
    with pytest.raises(NotResetError, match="render was called before reset"):
        env.render()
    env.reset(seed=0)
    env.step(np.zeros((20, 1)))
    pictures = env.render()
    assert pictures is not None
    assert len(pictures) == 16
    assert (pictures[0] != pictures[1]).any()


def test_a_record_holds_every_sensor_step_and_begins_anew_with_the_episode() -> None:
    env = LocalisationVectorEnv(2, "BearingsOnly", overrides={"episode.steps": 8}, autoreset_mode="SameStep")
    recorder = Recorder(env.batch.tiles[0], 1)
    env.reset(seed=0)
    assert [instant.time for instant in recorder.look()] == [0.0]
    env.step(np.zeros((2, 1)))
    assert [instant.time for instant in recorder.look()] == [0.0, 1.0, 2.0, 3.0, 4.0]
    env.step(np.zeros((2, 1)))
    begun = recorder.look()
    assert [instant.time for instant in begun] == [0.0]
    truth = env.batch.tiles[0].truth[:2, 1]
    np.testing.assert_array_equal(begun[0].emitter, truth)
    (origin, bearing), offset = begun[0].bearings[0], truth - begun[0].platforms[0]
    np.testing.assert_array_equal(origin, begun[0].platforms[0])
    assert bearing == pytest.approx(np.arctan2(*offset), abs=5 * 3e-3)


def test_the_plane_in_space_is_east_and_north_of_the_emitter() -> None:
    """One kilometre along the meridian and the parallel, on the sphere's scale to a part in a hundred."""
    latitude, longitude = np.radians([48.0]), np.radians([11.0])
    origin = from_geodetic(latitude, longitude, np.zeros(1))[:, 0]
    plane = Plane(origin)
    north = from_geodetic(latitude + 1e3 / 6.378e6, longitude, np.zeros(1))[:, 0]
    east = from_geodetic(latitude, longitude + 1e3 / 6.378e6 / np.cos(latitude), np.zeros(1))[:, 0]
    np.testing.assert_allclose(plane.point(north), [0.0, 1e3], atol=10.0)
    np.testing.assert_allclose(plane.point(east), [1e3, 0.0], atol=10.0)
    np.testing.assert_allclose(plane.spread(4.0 * np.eye(3)), 4.0 * np.eye(2), atol=1e-12)


def test_the_ellipse_lies_two_deviations_out() -> None:
    covariance = np.array([[9.0, 2.0], [2.0, 4.0]])
    instant = Instant(0.0, np.zeros((1, 2)), np.zeros(2), np.array([5.0, -1.0]), covariance, [], 0.0, 0.0)
    offsets = ellipse(instant) - instant.estimate
    squares = np.einsum("ki,ij,kj->k", offsets, np.linalg.inv(covariance), offsets)
    np.testing.assert_allclose(squares, 4.0, rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_map_holds_all_it_must(seed: int) -> None:
    points = np.random.default_rng(seed).normal(0.0, 10.0 ** (seed + 1), (30, 2))
    view = Viewport.around(points, 10, 20, 300, 200)
    shown = view.pixels(points)
    assert ((shown >= [10, 20]) & (shown <= [310, 220])).all()
    east, north = view.pixels(view.centre + view.scale * np.eye(2)) - view.pixels(view.centre)
    np.testing.assert_allclose([east, north], [[1.0, 0.0], [0.0, -1.0]], atol=1e-9)
    assert 0.1 < view.bar / view.scale / view.width <= 0.25


def test_round_lengths() -> None:
    assert [nice(length) for length in (1.0, 1.2, 4.0, 9.0, 11.0, 2e4)] == [1.0, 1.5, 5.0, 10.0, 15.0, 2e4]
    assert [round_down(length) for length in (1.0, 4.9, 5.0, 99.0, 2e4)] == [1.0, 2.0, 5.0, 50.0, 2e4]
    assert [in_words(length) for length in (500.0, 2e4)] == ["500 m", "20 km"]


def test_what_is_no_number_is_not_drawn() -> None:
    canvas = Canvas(40, 40)
    blank = canvas.pixels()
    nowhere = np.full((3, 2), np.nan)
    canvas.line(nowhere, EMITTER, 3)
    canvas.dashes(nowhere, EMITTER)
    canvas.dot(nowhere[0], 5, EMITTER)
    np.testing.assert_array_equal(canvas.pixels(), blank)
    canvas.line(np.array([[5.0, 20.0], [15.0, 20.0], [np.nan, 0.0], [25.0, 20.0], [35.0, 20.0]]), EMITTER, 3)
    assert [bool((canvas.pixels()[20, x] == rgb(EMITTER)).all()) for x in (10, 20, 30)] == [True, False, True]


def test_far_away_is_clipped_and_not_wrapped() -> None:
    canvas = Canvas(40, 40)
    canvas.line(np.array([[20.0, 20.0], [1e12, 20.0]]), EMITTER, 3)
    assert pixels_of(canvas.pixels()[20:21, 20:], EMITTER) >= 18


@pytest.mark.parametrize("env", [LocalisationEnv, LocalisationVectorEnv])
def test_unknown_modes_are_refused(env) -> None:
    with pytest.raises(ScenarioError, match=r"did you mean 'rgb_array'"):
        env(render_mode="rgb_aray")


def test_worlds_elsewhere_are_not_shown() -> None:
    with pytest.raises(ValueError, match="workers=1"):
        LocalisationVectorEnv(1024, workers=2, render_mode="rgb_array")


def test_without_pygame_one_line_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pygame", None)
    canvases.pygame.cache_clear()
    try:
        with pytest.raises(DependencyNotInstalled, match=r"pip install 'passloc\[render\]'"):
            LocalisationEnv(render_mode="rgb_array")
    finally:
        canvases.pygame.cache_clear()


def test_a_window_shows_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """On SDL's dummy display, which is a display that nobody sees."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shown: list[int] = []
    monkeypatch.setattr(Renderer, "_draw", Renderer.show, raising=False)
    monkeypatch.setattr(Renderer, "show", lambda self: (shown.append(1), self._draw())[0])
    env = LocalisationEnv(render_mode="human")
    env.reset(seed=0)
    env.step(np.zeros(1, np.float32))
    assert env.render() is None
    assert len(shown) == 2
    env.close()


def test_no_display_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    with pytest.raises(RenderError, match="use render_mode='rgb_array'"):
        LocalisationEnv(render_mode="human")


@pytest.mark.skipif("DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ, reason="there is a display here")
def test_what_nobody_sees_is_no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    with pytest.raises(RenderError, match="use render_mode='rgb_array'"):
        LocalisationEnv(render_mode="human")
