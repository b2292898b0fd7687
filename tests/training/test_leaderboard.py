"""The leaderboard: kept results are used again only for the very same question, and the page says what they say."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from agents import AgentFile, LearnedPolicy, find_policy, shipped
from passloc_env import SCENARIOS
from passloc_env.distributions import Uniform
from passloc_env.errors import InputError
from passloc_env.models import observation_names
from passloc_env.simulation import Simulation
from passloc_env.tracking import InteractingModels
from training.commands import EVALUATION_SEED, Leaderboard
from training.evaluate import compare, evaluate
from training.leaderboard import Store, Variant, board, entrants, leaderboard, variants
from training.leaderboard.entrants import OPTIMUM, planners
from training.leaderboard.picture import COLOURS
from training.optimum import NAME, Settings

EPISODES, SEED = 5, 40_000
TINY = Variant(
    "Tiny", "BearingsOnly, tiny", SCENARIOS["BearingsOnly"].override({"episode.steps": 16, "episode.decision_every": 8})
)


def only(name, variant=TINY):
    ((found,), notes) = entrants(variant, name)
    assert notes == []
    return found


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "kept", EPISODES, SEED)


def agent(folder, scenario, flies, bias=0.0):
    """An agent that always does the same."""
    names = observation_names(scenario)
    sizes = [len(names), scenario.action_size]
    weights = {
        f"actor.0.{kind}": np.full(shape, bias if kind == "bias" else 0.0, np.float32)
        for kind, shape in (("weight", sizes[::-1]), ("bias", sizes[1:]))
    }
    card = {
        "architecture": {"actor": sizes},
        "observation": list(names),
        "scenario": scenario.to_dict(),
        "flies": flies,
    }
    folder.mkdir(parents=True, exist_ok=True)
    AgentFile(weights, card).save(folder)


def test_an_evaluation_follows_from_its_scores():
    """What :func:`evaluate` says is what :func:`compare` says of the same episodes."""
    policies = [find_policy(name, TINY.scenario) for name in ("circle", "straight")]
    flown = evaluate(TINY.scenario, policies, EPISODES, SEED)
    seconds = {verdict.policy: verdict.milliseconds_per_decision / 1e3 for verdict in flown.verdicts}
    again = compare(TINY.scenario, flown.scores, seconds, SEED)
    assert again.to_json() == flown.to_json()


def test_kept_results_are_those_of_the_environment(store):
    entrant = only("zigzag")
    assert store.kept(TINY, entrant) is None
    scores, seconds = store.flown(TINY, entrant)
    direct = evaluate(TINY.scenario, [find_policy("zigzag", TINY.scenario)], EPISODES, SEED)
    (expected,) = direct.scores.values()
    kept, kept_seconds = store.kept(TINY, entrant)
    assert kept_seconds == seconds > 0.0
    for name, values in vars(expected).items():
        np.testing.assert_array_equal(getattr(kept, name), values)
        np.testing.assert_array_equal(getattr(scores, name), values)
        assert getattr(kept, name).dtype == values.dtype


def test_results_of_another_question_are_no_answer(store):
    """Other episodes, seed, scenario or parameters of the policy: to be flown anew; the first answer stays."""
    entrant = only("zigzag")
    store.flown(TINY, entrant)
    assert Store(store.folder, EPISODES + 1, SEED).kept(TINY, entrant) is None
    assert Store(store.folder, EPISODES, SEED + 1).kept(TINY, entrant) is None
    sharper = Variant(TINY.name, TINY.title, TINY.scenario.override({"sensors.0.sigma": 1e-3}))
    assert store.kept(sharper, entrant) is None
    assert store.kept(TINY, only("zigzag:leg=16")) is None
    assert store.kept(TINY, only("circle")) is None
    Store(store.folder, EPISODES + 1, SEED).flown(TINY, entrant)
    assert store.kept(TINY, entrant) is not None


def test_planners_are_told_apart_by_what_tables_do_not_show(store):
    """Both are called alike."""
    one, other = only("horizon:seconds=16"), only("horizon:seconds=16:legs=2")
    assert one.name == other.name
    assert one.stamp != other.stamp


def test_files_that_are_no_results_are_flown_again(store):
    entrant = only("circle")
    expected, _ = store.flown(TINY, entrant)
    (path,) = (store.folder / "Tiny").iterdir()
    whole = path.read_bytes()
    for content in (b"", b"nonsense", whole[: len(whole) // 2]):
        path.write_bytes(content)
        assert store.kept(TINY, entrant) is None
    np.savez(path, about=np.array({"policy": "pickled"}, dtype=object))
    assert store.kept(TINY, entrant) is None
    scores, _ = store.flown(TINY, entrant)
    np.testing.assert_array_equal(scores.log_range_bound, expected.log_range_bound)
    assert [path.suffix for path in (store.folder / "Tiny").iterdir()] == [".npz"]


def test_a_stamp_inside_must_agree_too(store):
    """A file under a false name is not believed."""
    one, other = only("circle"), only("straight")
    store.flown(TINY, one)
    (path,) = (store.folder / "Tiny").iterdir()
    store.flown(TINY, other)
    (wrong,) = (found for found in (store.folder / "Tiny").iterdir() if found != path)
    wrong.write_bytes(path.read_bytes())
    assert store.kept(TINY, other) is None


def test_an_agent_trained_anew_is_another(tmp_path, monkeypatch, store):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    agent(tmp_path / "Mine", TINY.scenario, ["BearingsOnly"])
    store.flown(TINY, only("agent:Mine"))
    assert store.kept(TINY, only("agent:Mine")) is not None
    agent(tmp_path / "Mine", TINY.scenario, ["BearingsOnly"], bias=0.5)
    assert store.kept(TINY, only("agent:Mine")) is None


def test_variants_are_every_scenario_and_what_is_worth_changing():
    found = variants()
    names = [variant.name for variant in found]
    assert len(set(names)) == len(names)
    assert set(SCENARIOS) < set(names)
    sigmas = sorted(v.scenario.sensors[0].sigma for v in found if v.name.split("-")[0] == "BearingsOnly")
    assert sigmas == [1e-3, 3e-3, 6e-3, 17e-3]
    (multiple,) = (variant for variant in found if variant.name == "BearingDoppler-IMM")
    assert multiple.scenario.tracker == InteractingModels()
    assert multiple.scenario.replace(tracker=SCENARIOS["BearingDoppler"].tracker) == SCENARIOS["BearingDoppler"]
    assert all(variant.scenario.name in SCENARIOS for variant in found)
    assert [variant.name for variant in variants("CrossFix, passloc/BearingDoppler-v0")] == [
        "BearingDoppler",
        "BearingDoppler-IMM",
        "CrossFix",
    ]
    with pytest.raises(InputError, match="did you mean 'CrossFix'"):
        variants("CrosFix")


def test_fixed_cases_come_with_a_family_around_them():
    """A thousand draws reach from half to twice the range and speed, all around; the rest is that of the case."""
    families = {v.name.removesuffix("-family"): v.scenario for v in variants() if v.name.endswith("-family")}
    cases = [f"BearingDopplerCase{case}" for case in ("1a", "1b", "2a", "2b")]
    assert sorted(families) == [*cases, "OwnShipModerate", "OwnShipSevere"]
    for name, around in families.items():
        case = SCENARIOS[name]
        simulation = Simulation(around, 1000)
        simulation.reset(np.arange(1000), [np.random.default_rng(index) for index in range(1000)])
        away, speed = (np.hypot(*simulation.truth[rows]) for rows in (slice(0, 2), slice(2, 4)))
        (x, y), (v_x, v_y) = case.target.start.position, case.target.start.velocity
        for found, value in ((away, np.hypot(x, y)), (speed, np.hypot(v_x, v_y))):
            assert 0.5 <= (found / value).min() < 0.52
            assert 1.98 < (found / value).max() <= 2.0
        assert np.unique(np.floor(np.arctan2(*simulation.truth[:2]) / (np.pi / 4))).size == 8
        assert around.platforms[0].heading == Uniform(low=-np.pi, high=np.pi)
        for sensor, known in zip(around.sensors, case.sensors, strict=True):
            assert sensor.sigma == Uniform(low=0.7 * known.sigma, high=1.5 * known.sigma)
        kept = {"target.start": case.target.start, "platforms.0.heading": case.platforms[0].heading}
        kept |= {f"sensors.{index}.sigma": sensor.sigma for index, sensor in enumerate(case.sensors)}
        assert around.override(kept) == case


@pytest.mark.parametrize("variant", variants(), ids=lambda variant: variant.name)
def test_everybody_finds_a_place(variant):
    """The reference leads, names are distinct, and whoever is told the truth says so."""
    found, notes = entrants(variant)
    names = [entrant.name for entrant in found]
    assert len(set(names)) == len(names)
    assert names[0] == ("circle" if "circle" in names else "stationary")
    assert {entrant.kind for entrant in found} <= set(COLOURS)
    for entrant in found:
        assert ("truth" in entrant.name) == (entrant.kind in ("truth", "optimum"))
    refused = any(note.startswith(f"Without {OPTIMUM}") for note in notes)
    assert (NAME in names or refused) == any(name.startswith("greedy-truth") for name in planners(variant))
    assert not (NAME in names and refused)
    assert bool(planners(variant)) == bool(variant.scenario.action_size)


def test_horizons_fit_the_pace():
    (moderate, _), (near, *_) = variants("OwnShipModerate"), variants("BearingsOnly")
    assert {"horizon:seconds=480", "horizon:seconds=960", "shrinking", "greedy-truth"} <= set(planners(moderate))
    assert {"horizon:seconds=24", "horizon:seconds=48", "horizon:seconds=96", "shrinking"} <= set(planners(near))
    (satellites,) = variants("DualSatellite")
    assert planners(satellites) == ("greedy",)


def test_shipped_agents_play_where_they_fit(tmp_path, monkeypatch):
    """An agent that is for a scenario but cannot fly a variant of it is named in a note."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    agent(tmp_path / "Fits", SCENARIOS["BearingsOnly"], ["BearingsOnly"])
    agent(tmp_path / "Sees-else", SCENARIOS["CrossFix"], ["BearingsOnly"])
    agent(tmp_path / "Else", SCENARIOS["BearingsOnly"], ["CrossFix"])
    found, notes = entrants(variants("BearingsOnly")[1])
    assert [entrant.name for entrant in found if entrant.kind == "learned"] == ["learned Fits"]
    (note,) = notes
    assert note.startswith("Without Sees-else: it was trained on ")
    assert str(tmp_path) not in note
    assert isinstance(next(e for e in found if e.kind == "learned").policy, LearnedPolicy)


@pytest.fixture
def tiny_board(tmp_path, monkeypatch):
    """A board with two tiny variants and a quick optimum."""
    whole = SCENARIOS["OwnShipModerate"].override({"episode.steps": 4})
    tiny = (TINY, Variant("Own", "OwnShipModerate", whole))
    monkeypatch.setattr(board, "variants", lambda names: tiny)
    quick = Settings(objective="log_range_bound", restarts=2, iterations=3, polish=2, seed=0)
    monkeypatch.setattr(sys.modules[planners.__module__], "SETTINGS", quick)
    return Leaderboard(
        policies="circle,fly-at,greedy-truth,optimum",
        episodes=EPISODES,
        seed=SEED,
        out=tmp_path / "page",
        cache=tmp_path / "kept",
    )


def cells(page, heading):
    """The table under a heading: rows of cells by the first of them."""
    part = page.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line[:1] == "|"]
    header, _, *body = rows
    return {row[0]: dict(zip(header, row, strict=True)) for row in body}


def test_the_page_says_what_was_flown(tiny_board):
    page = leaderboard(tiny_board).read_text(encoding="utf-8")
    rows = cells(page, TINY.title)
    policies = [find_policy(name, TINY.scenario) for name in ("circle", "fly-at", "greedy-truth")]
    expected = evaluate(TINY.scenario, policies, EPISODES, SEED)
    assert len(rows) == 4
    for verdict in expected.verdicts:
        row = rows[verdict.policy]
        bound, advantage = verdict.log_range_bound, verdict.advantage
        assert row["log range bound"] == f"{bound.value:.3f} [{bound.low:.3f}, {bound.high:.3f}]"
        assert row["minus circle's"] == f"{advantage.value:.3f} [{advantage.low:.3f}, {advantage.high:.3f}]"
    values = [float(row["log range bound"].split()[0]) for row in rows.values()]
    assert values == sorted(values)
    optimum, _ = Store(tiny_board.cache, EPISODES, SEED).kept(TINY, only(OPTIMUM))
    assert rows[NAME]["log range bound"].startswith(f"{optimum.log_range_bound.mean():.3f} ")
    assert "tracker UnscentedKalman" in page
    assert "tracker RangeBank" in page


def test_own_ship_tables_count_kilometres(tiny_board):
    page = leaderboard(tiny_board).read_text(encoding="utf-8")
    rows = cells(page, "OwnShipModerate")
    scenario = board.variants("")[1].scenario
    evaluation = evaluate(scenario, [find_policy("circle", scenario)], EPISODES, SEED)
    errors = evaluation.scores["circle"].end_position_error / 1e3
    shown = {name: float(rows["circle"][name].split()[0]) for name in ("median, km", "p95, km", "p99, km")}
    expected = dict(zip(shown, np.percentile(errors, [50, 95, 99]), strict=True))
    assert shown == pytest.approx(expected, abs=0.0051)
    assert float(rows["circle"]["end error RMS, km"].split()[0]) == pytest.approx(
        np.sqrt(np.mean(errors**2)), abs=0.0051
    )
    assert "median, km" not in cells(page, TINY.title)["circle"]


def test_the_page_is_whole(tiny_board):
    """Links lead somewhere, pictures are there, the command makes the same page again."""
    path = leaderboard(tiny_board)
    page = path.read_text(encoding="utf-8")
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", page)
    assert pictures == ["Tiny.png", "Own.png"]
    assert sorted(found.name for found in path.parent.iterdir()) == sorted(["index.md", *pictures])
    for picture in pictures:
        assert (path.parent / picture).read_bytes().startswith(b"\x89PNG")
    headings = {
        re.sub(r"[^\w-]", "", title.lower().replace(" ", "-")) for title in re.findall(r"^## (.*)$", page, re.MULTILINE)
    }
    links = set(re.findall(r"\]\(#(.*?)\)", page))
    assert links == headings == {"bearingsonly-tiny", "ownshipmoderate"}
    command = re.search(r"```sh\n(.*)\n```", page)[1]
    words = shlex.split(command)
    assert words[:2] == ["passloc", "leaderboard"]
    assert words[words.index("--seed") + 1] == str(SEED) != str(EVALUATION_SEED)
    assert words[words.index("--policies") + 1] == tiny_board.policies


def test_the_best_knows_no_more_than_it_may(tiny_board):
    """Neither the optimum nor a planner told the truth is the best policy of the summary, nor one that violates."""
    page = leaderboard(tiny_board).read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[(.*?)\]\(.*?\) \| (.*?) \| (.*?) \|", page, re.MULTILINE)
    assert [row[:2] for row in rows] == [
        (TINY.title, "log range bound"),
        ("OwnShipModerate", "end error RMS, km"),
    ]
    assert all(best in ("circle", "fly-at") for *_, best in rows)


def test_goes_on_where_it_stopped(tiny_board, monkeypatch):
    """After an interruption only what is missing is flown; a finished board flies nothing; afresh, everything."""
    flown = []
    real = Store.keep

    def counted(self, variant, entrant, scores, seconds):
        if len(flown) == 3:
            raise KeyboardInterrupt
        flown.append((variant.name, entrant.name))
        real(self, variant, entrant, scores, seconds)

    monkeypatch.setattr(Store, "keep", counted)
    with pytest.raises(KeyboardInterrupt):
        leaderboard(tiny_board)
    assert not (tiny_board.out / "index.md").exists()
    first, flown[:] = list(flown), [None]

    def watched(self, variant, entrant, scores, seconds):
        flown.append((variant.name, entrant.name))
        real(self, variant, entrant, scores, seconds)

    monkeypatch.setattr(Store, "keep", watched)
    page = leaderboard(tiny_board).read_text(encoding="utf-8")
    rest = flown[1:]
    assert len(first) == 3
    assert len(rest) == 8 - 3
    assert not set(first) & set(rest)
    flown.clear()
    assert leaderboard(tiny_board).read_text(encoding="utf-8") == page
    assert flown == []
    leaderboard(Leaderboard(**{**vars(tiny_board), "fresh": True}))
    assert len(flown) == 8


def test_the_optimum_keeps_its_paths(tiny_board):
    leaderboard(tiny_board)
    kept = [path.name for path in (tiny_board.cache / "Tiny").iterdir() if ".paths." in path.name]
    assert len(kept) == 1


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("--episodes", "0"), "at least 1"),
        (("--seed", "-1"), "seed"),
        (("--scenarios", "BearingOnly"), "did you mean 'BearingsOnly'?"),
        (("--scenarios", "BearingsOnly,"), "scenario"),
        (("--policies", "cirle"), "did you mean 'circle'?"),
        (("--policies", "legs"), "legs"),
        (("--policies", "agent:nobody"), "agent"),
        (("--policies", "optimum", "--scenarios", "CrossFix"), "trajectory optimum"),
        (("--out", "file"), "not a folder"),
        (("--cache", "file"), "not a folder"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_faults_are_one_line_and_nothing_is_flown(refused, words, hint, monkeypatch):
    monkeypatch.setattr(board, "fly_all", lambda *arguments: pytest.fail("flown before looking"))
    Path("file").write_text("", encoding="utf-8")
    assert hint in refused("leaderboard", *words)
    assert not Path("docs/leaderboard/index.md").exists()


def test_command(passloc):
    words = ("--scenarios", "OwnShipModerate", "--policies", "circle,legs", "--episodes", "2", "--out", "page")
    status, out, err = passloc("leaderboard", *words)
    assert (status, err) == (0, "")
    assert "4 results, 0 of them kept from before" in out
    assert "page/index.md" in out
    status, out, _ = passloc("leaderboard", *words)
    assert status == 0
    assert "4 results, 4 of them kept from before" in out


@pytest.mark.parametrize("name", ["leaderboard", "card", "tune", "ablate", "seeds"])
def test_help(passloc, name):
    status, out, err = passloc(name, "--help")
    assert (status, err) == (0, "")
    assert f"passloc {name}" in out
    assert len(out.splitlines()) > 10
