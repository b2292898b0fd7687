"""Reports as a browser shows them: whole, silent, usable with keys and on a phone; and what cannot be reported."""

import ast
import json
import math
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

pytest.importorskip("stable_baselines3")
pytest.importorskip("plotly")

from agents import Circle, LearnedPolicy, find_policy
from passloc_env import SCENARIOS
from training import cli
from training.commands import EVALUATION_SEED
from training.evaluate import evaluate, read_evaluation
from training.hyperparameters import Hyperparameters
from training.replay import record
from training.report.charts import scores
from training.report.errors import error_curves
from training.report.page import Page, html
from training.report.player import _numbers, played
from training.report.subject import read_subject
from training.statistics import Estimate
from training.table import ranked
from training.train import run

SHORT = SCENARIOS["BearingsOnly"].override({"episode.steps": 40})
ASKED = ("circle", "zigzag:angle=60", "zigzag:angle=30", "straight", "fly-at", "stationary")
TINY = Hyperparameters(decisions=256, environments=8, rollout=16, batch_size=64, epochs=1, network=(8,))
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    """A saved evaluation of six rules."""
    judged = evaluate(SHORT, [find_policy(name, SHORT) for name in ASKED], episodes=24)
    judged.asked = ASKED
    path = tmp_path_factory.mktemp("evaluated") / "evaluation.json"
    judged.save(path)
    return path


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A run folder of hardly any training."""
    folder = tmp_path_factory.mktemp("run")
    run(SHORT, TINY, folder, seed=0)
    return folder


@pytest.fixture(scope="module")
def reported(evaluation, trained, tmp_path_factory):
    """The reports of both, by name."""
    folder = tmp_path_factory.mktemp("reports")
    words = {"evaluation": str(evaluation), "run": str(trained)}
    for name, source in words.items():
        assert cli.main(["report", source, "--episodes", "16", "--out", str(folder / f"{name}.html")]) == 0
    return {name: folder / f"{name}.html" for name in words}


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    with playwright.sync_playwright() as started:
        yield started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])


@pytest.fixture
def opened(browser):
    """Opens a page in a window of a size; what it complained about and asked the network for must stay empty."""
    complaints = []

    def opened(path: Path, width: int = 1200, height: int = 900):
        page = browser.new_page(viewport={"width": width, "height": height})
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: request.url.startswith("http") and complaints.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_function("player.drawn.then(() => true)")
        return page

    yield opened
    assert complaints == []


def observer(page, row: int = 0):
    """Where the map says that the observer is, and how long its track is."""
    track = page.evaluate(f"document.getElementById('map-{row}').data[5]")
    return (track["x"][-2], track["y"][-2]), len(track["x"]) - 1


def test_playing_moves_the_observer_and_stops_at_the_end(opened, reported):
    page = opened(reported["evaluation"])
    before, _ = observer(page)
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("player.frame > 2")
    after, length = observer(page)
    assert after != before
    assert length > 2
    page.get_by_role("button", name="Pause").click()
    stopped = page.evaluate("player.frame")
    page.wait_for_timeout(300)
    assert page.evaluate("player.frame") == stopped
    page.evaluate("player.show(player.frames - 2)")
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("player.timer === null")
    assert page.evaluate("player.frame === player.frames - 1")


def test_the_slider_seeks_with_mouse_and_keys(opened, reported):
    page = opened(reported["evaluation"])
    slider = page.get_by_role("slider", name="Time")
    slider.fill("20")
    instants = record(SHORT, find_policy("circle", SHORT), EVALUATION_SEED).instants
    row = page.evaluate("read('flights').flights.findIndex((flight) => flight.name === 'circle')")
    place, length = observer(page, row)
    assert length == 21
    # What is shown is what was flown, to the 0.1 m that the page rounds to.
    np.testing.assert_allclose(place, instants[20].platforms[0] / 1e3, atol=1e-4)
    assert slider.get_attribute("aria-valuetext") == f"{instants[20].time:.0f} seconds"
    slider.focus()
    page.keyboard.press("ArrowRight")
    assert observer(page, row)[1] == 22
    page.keyboard.press("Home")
    assert observer(page, row)[1] == 1


def column(page, number: int) -> list[str]:
    return page.evaluate(f"[...document.querySelectorAll('#table tbody tr')].map((r) => r.cells[{number}].textContent)")


def test_the_table_is_the_evaluation_and_sorts(opened, reported, evaluation):
    page = opened(reported["evaluation"])
    judged = ranked(read_evaluation(evaluation))
    assert column(page, 0) == [verdict.policy for verdict in judged]
    headings = page.locator("#table thead th")
    number = headings.all_inner_texts().index("violations, %")
    for direction, sign in (("ascending", 1), ("descending", -1)):
        headings.nth(number).get_by_role("button").click()
        assert headings.nth(number).get_attribute("aria-sort") == direction
        values = [sign * float(text.split()[0]) for text in column(page, number)]
        assert values == sorted(values)
    headings.first.get_by_role("button").press("Enter")
    assert column(page, 0) == sorted(column(page, 0))
    assert page.locator("#table [aria-sort]").count() == 1


@pytest.mark.parametrize("name", ["evaluation", "run"])
@pytest.mark.parametrize("width", [360, 1200])
def test_nothing_runs_over_the_edge(opened, reported, name, width):
    page = opened(reported[name], width=width, height=800)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    for place in ("#scores", "#rates", "#map-0", "#course", "#errors"):
        box = page.locator(place).bounding_box()
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= width
        assert box["width"] > 0.5 * min(width, 400)
    play = page.get_by_role("button", name="Play").bounding_box()
    assert min(play["width"], play["height"]) >= 40.0


def test_everything_can_be_read_aloud_and_reached_by_keys(opened, reported):
    page = opened(reported["run"])
    assert page.locator("h1").count() == 1
    assert page.evaluate("document.documentElement.lang") == "en"
    assert page.locator("[role=img]:not([aria-label])").count() == 0
    assert page.locator("section:not([aria-labelledby])").count() == 0
    assert page.get_by_role("heading", name="Learning").count() == 1
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.tagName"))
    assert {"play", "when", "SUMMARY", "BUTTON"} <= reached


def luminance(colour: str) -> float:
    parts = [int(part) / 255.0 for part in re.findall(r"\d+", colour)[:3]]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def test_words_stand_out_from_the_page(opened, reported):
    """Contrast of at least 4.5 to 1, as the Web Content Accessibility Guidelines ask (1.4.3, level AA)."""
    page = opened(reported["run"])
    seen = page.evaluate(
        """[...document.querySelectorAll('h1,h2,p,caption,td,th,.interval,button,summary,li,figcaption,output')]
        .map((e) => { let b = e; while (b && getComputedStyle(b).backgroundColor === 'rgba(0, 0, 0, 0)')
        b = b.parentElement; return [getComputedStyle(e).color, b ? getComputedStyle(b).backgroundColor :
        'rgb(255, 255, 255)']; })"""
    )
    assert len(seen) > 50
    for front, behind in {tuple(pair) for pair in seen}:
        light, dark = sorted((luminance(front), luminance(behind)), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (front, behind)


def test_a_replay_is_a_page_too(opened, tmp_path):
    path = tmp_path / "new" / "replay.html"
    words = ["replay", "CrossFix", "--policy", "circle,circle", "--html", str(path), "--override", "episode.steps=10"]
    assert cli.main(words) == 0
    page = opened(path)
    assert page.locator("figcaption b").all_inner_texts() == ["circle (1)", "circle (2)"]
    assert observer(page)[0] == observer(page, 1)[0]


def test_who_is_shown(evaluation):
    """The reference, the best and the worst, in the order of the table."""
    subject = read_subject(evaluation, 1)
    names = [verdict.policy for verdict in ranked(subject.evaluation)]
    shown = list(subject.shown())
    assert len(shown) == 4
    assert set(shown) >= {subject.evaluation.reference, names[0], names[-1]}
    assert shown == [name for name in names if name in shown]


def test_who_is_gone_is_named(evaluation, tmp_path):
    data = json.loads(evaluation.read_text(encoding="utf-8"))
    data["asked"][0] = "runs/gone"
    path = tmp_path / "evaluation.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    subject = read_subject(path, 1)
    assert "circle" not in subject.policies
    assert subject.remarks == ["circle: not found here, so no flight is shown."]


def test_an_evaluation_comes_back_as_it_was_saved(evaluation):
    text = evaluation.read_text(encoding="utf-8")
    assert read_evaluation(evaluation).to_json() == text


def test_curves_are_medians_of_what_was_flown():
    """Against flights made one by one by the recorder of pictures: other code, the same episodes."""
    policy = find_policy("circle", SHORT)
    curve = error_curves(SHORT, {"circle": policy}, 3, 50)["circle"]
    open_end = SHORT.override({"episode.early_end": False})
    flown = [record(open_end, policy, seed).instants[1:] for seed in (50, 51, 52)]
    error = np.array([[instant.error for instant in instants] for instants in flown])
    bound = np.array([[instant.bound for instant in instants] for instants in flown])
    np.testing.assert_allclose(curve.error, 100.0 * np.median(error, axis=0), rtol=1e-9)
    as_good = scipy.stats.halfnorm.ppf(0.5) * np.median(bound, axis=0)
    np.testing.assert_allclose(curve.bound, 100.0 * as_good, rtol=1e-9)
    np.testing.assert_array_equal(curve.time, [instant.time for instant in flown[0]])


def test_long_flights_are_thinned_and_stay_in_step():
    """One that ends early is shown at the same times as the others, and its end; what is unknown is null."""
    scenario = SCENARIOS["BearingsOnly"]
    recordings = {name: record(scenario, find_policy(name, scenario), 1_000_003) for name in ("straight", "circle")}
    data = played(scenario, recordings, 1_000_003)
    short, long = sorted((flight["time"] for flight in data["flights"]), key=len)
    assert short[-1] < long[-1]
    assert len(long) <= 121
    assert short[:-1] == long[: len(short) - 1]
    assert long[len(short) - 2] < short[-1] <= long[len(short) - 1]
    for flight in data["flights"]:
        flown = recordings[flight["name"]].instants
        assert (flight["time"][0], flight["time"][-1]) == (flown[0].time, flown[-1].time)
    assert _numbers(np.array([1.26, np.nan, np.inf]), 1) == [1.3, None, None]
    json.dumps(data, allow_nan=False)


def test_names_cannot_break_out_of_the_page():
    name = "</script><script>alert(1)</script>"
    player = played(SHORT, {name: record(SHORT, find_policy("circle", SHORT), 3)}, 3)
    page = html(Page(title=name, configuration={name: name}, player=player)).partition("<body>")[2]
    assert name not in page
    assert page.count("alert(1)") == 7
    assert "</script><script>" not in page.replace("</script>\n<script>", "")


def test_the_agent_of_a_run_flies_under_its_own_name_alone(trained, tmp_path):
    """Also where its folder holds an evaluation in which it is not the first, made when it lay elsewhere."""
    folder = tmp_path / trained.name
    shutil.copytree(trained, folder)
    judged = evaluate(SHORT, [find_policy("circle", SHORT), find_policy(str(trained), SHORT)], episodes=4)
    judged.asked = ("circle", str(trained))
    judged.save(folder / "evaluation.json")
    policies = read_subject(folder, 1).policies
    assert {name: type(policy) for name, policy in policies.items()} == {"circle": Circle, trained.name: LearnedPolicy}


def test_names_that_are_numbers_stay_names(evaluation):
    judged = read_evaluation(evaluation)
    for number, verdict in enumerate(judged.verdicts):
        verdict.policy = str(number)
    assert scores(judged).layout.yaxis.type == "category"


def test_those_without_a_score_come_last(evaluation):
    judged = read_evaluation(evaluation)
    judged.verdicts[2].log_range_bound = Estimate(math.nan, math.nan, math.nan)
    order = ranked(judged)
    assert order[-1] is judged.verdicts[2]
    values = [verdict.log_range_bound.value for verdict in order[:-1]]
    assert values == sorted(values)


def changed(data, change: str) -> str:
    """An evaluation with one thing changed, as text."""
    where, _, value = change.partition("=")
    *path, last = where.split(".")
    inner = data
    for name in path:
        inner = inner[int(name) if name.isdigit() else name]
    inner[last] = ast.literal_eval(value)
    return json.dumps(data)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("nowhere", "nowhere is not there: name a run folder or an evaluation file"),
        ("empty", "empty is not a run folder"),
        ("cut.json", "cut.json is not a whole evaluation"),
        ("other.json", "other.json is not a whole evaluation"),
        ("binary.json", "binary.json is not a whole evaluation"),
        ("policies=[]", "its reference 'circle' is none of its policies"),
        ("reference='nobody'", "its reference 'nobody' is none of its policies"),
        ("policies.0.log_range_bound=3", "AttributeError"),
        ("policies.0.policy=None", "None must be str"),
        ("episodes=0", "must be at least 1"),
        ("seed=-3", "must be at least 0"),
    ],
)
def test_what_cannot_be_reported_is_one_line(source, said, evaluation, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    text = evaluation.read_text(encoding="utf-8")
    Path("cut.json").write_text(text[: len(text) // 2], encoding="utf-8")
    Path("other.json").write_text('{"policies": [1]}', encoding="utf-8")
    Path("binary.json").write_bytes(os.urandom(8) + b"\xff\xfe")
    if "=" in source:
        Path("changed.json").write_text(changed(json.loads(text), source), encoding="utf-8")
        source = "changed.json"
    assert cli.main(["report", source, "--out", "new/page.html"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(Path().rglob("*.html*"))


def test_a_page_ends_as_one(evaluation, capsys):
    assert cli.main(["report", str(evaluation), "--out", "report.pdf"]) == 2
    assert "out = 'report.pdf' is not possible: must end in .html" in capsys.readouterr().err
