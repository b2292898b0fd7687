"""Replays: everybody flies the same episode, and files are whole or not there."""

from itertools import pairwise
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from agents import find_policy
from passloc_env import SCENARIOS
from passloc_env.rendering.frame import SIZE
from passloc_env.rendering.viewport import Viewport
from training import film, replay
from training.cli import main
from training.replay import record, side_by_side

SHORT = SCENARIOS["BearingsOnly"].override({"episode.steps": 12})
WORDS = ["replay", "BearingsOnly", "--override", "episode.steps=12"]


def test_pictures_are_the_first_look_and_every_decision() -> None:
    pictures = list(side_by_side([record(SHORT, find_policy("circle", SHORT), 3)]))
    assert len(pictures) == 4
    assert all((a != b).any() for a, b in pairwise(pictures))
    again = list(side_by_side([record(SHORT, find_policy("circle", SHORT), 3)]))
    np.testing.assert_array_equal(pictures, again)


def test_who_has_ended_waits_for_the_others() -> None:
    longer = SHORT.override({"episode.steps": 20})
    recordings = [record(each, find_policy("circle", each), 3) for each in (SHORT, longer)]
    frames = list(side_by_side(recordings))
    assert [frame.shape for frame in frames] == [(SIZE, 2 * SIZE, 3)] * 6
    left = [frame[:, :SIZE] for frame in frames]
    np.testing.assert_array_equal(left[-1], left[3])
    assert (frames[-1][:, SIZE:] != frames[3][:, SIZE:]).any()


def test_all_maps_have_one_scale_all_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures that are to be compared must be comparable, whoever flies far away."""
    views = []
    around = Viewport.around.__func__
    monkeypatch.setattr(Viewport, "around", classmethod(lambda *a: views.append(around(*a)) or views[-1]))
    recordings = [record(SHORT, find_policy(name, SHORT), 3) for name in ("circle", "straight")]
    assert len(list(side_by_side(recordings))) == 4
    assert len({(view.scale, *view.centre) for view in views}) == 1
    (view,) = views[:1]
    inside = np.array([view.left, view.top]), np.array([view.left + view.width, view.top + view.height])
    for instant in (instant for recording in recordings for instant in recording.instants):
        for place in (*instant.platforms, instant.emitter):
            assert (inside[0] <= view.pixels(place)).all()
            assert (view.pixels(place) <= inside[1]).all()


def test_files_hold_every_decision(tmp_path: Path) -> None:
    gif, mp4 = tmp_path / "new" / "flown.gif", tmp_path / "flown.mp4"
    assert main([*WORDS, "--policy", "circle,straight", "--gif", str(gif), "--mp4", str(mp4)]) == 0
    with Image.open(gif) as image:
        assert image.size == (2 * SIZE, SIZE)
        assert image.n_frames >= 4
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(mp4))
    # The end is held for a second and a half.
    assert frames == 4 + 15
    assert seconds == pytest.approx(1.9, abs=0.11)
    assert {path.name for path in tmp_path.iterdir()} == {"new", "flown.mp4"}


def test_what_is_asked_for_as_a_page_and_as_pictures_is_flown_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("plotly")
    flown = []
    monkeypatch.setattr(replay, "record", lambda *what: flown.append(what[1].name) or record(*what))
    page, gif = tmp_path / "flown.html", tmp_path / "flown.gif"
    assert main([*WORDS, "--policy", "circle,straight", "--html", str(page), "--gif", str(gif)]) == 0
    assert flown == ["circle", "straight"]
    assert page.exists()
    assert gif.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--gif", "film.png"], "gif = 'film.png' is not possible: must end in .gif"),
        (["--policy", "circel"], "did you mean 'circle'?"),
        (["--seed", "-1"], "seed = -1 is not possible"),
    ],
)
def test_what_cannot_be_replayed_is_one_line(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*WORDS, *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_without_a_display_a_file_is_advised(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    assert main(WORDS) == 2
    assert "name a file with --gif or --mp4" in capsys.readouterr().err


@pytest.mark.parametrize("write", [film.write_gif, film.write_mp4])
def test_a_film_that_breaks_off_leaves_nothing(write, tmp_path: Path) -> None:
    def frames():
        yield np.zeros((4, 4, 3), np.uint8)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / f"film.{write.__name__[-3:]}", frames(), 10)
    assert list(tmp_path.iterdir()) == []
