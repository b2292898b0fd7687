"""Judging policies: verdicts follow from the episodes, and the file holds all of it."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from agents import Circle, FlyAt, Straight, find_policy
from passloc_env import SCENARIOS, LocalisationEnv, Scenario
from passloc_env.distributions import Uniform
from passloc_env.motion import ConstantAcceleration
from passloc_env.tracking import UnscentedKalman
from training.evaluate import Evaluation, evaluate
from training.statistics import rate
from training.table import COLUMNS, columns_of, markdown_table, notes, ranked, rich_table, title

EPISODES = 24
SHORT = SCENARIOS["BearingsOnly"].override(
    {"episode.steps": 60, "target.start.range": Uniform(low=10.1e3, high=40e3), "episode.decision_every": 4}
)


@pytest.fixture(scope="module")
def evaluation() -> Evaluation:
    policies = [Circle(), Straight(), FlyAt(), find_policy("stationary", SHORT)]
    return evaluate(SHORT, policies, EPISODES, seed=50)


def strictly(text: str):
    """Standard JSON: neither NaN nor infinities."""

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_verdicts_follow_from_the_scores(evaluation):
    assert [verdict.policy for verdict in evaluation.verdicts] == ["circle", "straight", "fly-at", "stationary"]
    reference = evaluation.scores["circle"]
    for verdict in evaluation.verdicts:
        scores = evaluation.scores[verdict.policy]
        assert scores.end_error.shape == (EPISODES,)
        expected = {
            "log_range_bound": np.mean(scores.log_range_bound),
            "advantage": np.mean(scores.log_range_bound - reference.log_range_bound),
            "end_error": np.median(scores.end_error),
            "mean_error": np.median(scores.mean_error),
            "time_to_10": np.mean(scores.time_to_10),
            "time_to_5": np.mean(scores.time_to_5),
            "violations": np.mean(scores.violated),
            "lost": np.mean(scores.lost),
            "end_position_error": np.median(scores.end_position_error),
            "end_rms": np.sqrt(np.mean(scores.end_position_error**2)),
        }
        for name, value in expected.items():
            estimate = getattr(verdict, name)
            assert estimate.value == pytest.approx(value, rel=1e-12)
            assert estimate.low <= estimate.value <= estimate.high
        assert verdict.violations == rate(scores.violated)
        assert verdict.lost == rate(scores.lost)
        bound = np.sqrt(np.mean(scores.end_position_bound**2))
        assert verdict.efficiency == pytest.approx(expected["end_rms"] / bound, rel=1e-12)
        percentiles = np.percentile(scores.end_error, [50, 95, 99])
        assert list(verdict.end_error_percentiles.values()) == pytest.approx(list(percentiles))
        assert verdict.anees == pytest.approx(np.mean(scores.mean_nees) / 4.0, rel=1e-12)
        assert verdict.milliseconds_per_decision > 0.0


def test_manoeuvring_beats_keeping_straight(evaluation):
    """The advantage is paired with the first policy: nothing for itself, a clear loss for the blind ones."""
    circle, straight, _, stationary = evaluation.verdicts
    assert evaluation.reference == "circle"
    assert (circle.advantage.low, circle.advantage.value, circle.advantage.high) == (0.0, 0.0, 0.0)
    assert straight.advantage.low > 0.0
    assert stationary.advantage.low > 0.0
    assert 0.0 < evaluation.verdicts[2].violations.value < 1.0


def test_intervals_are_the_same_again():
    one, other = (evaluate(SHORT, [Straight(), Circle()], 5, seed=3) for _ in range(2))
    for mine, theirs in zip(one.verdicts, other.verdicts, strict=True):
        assert mine.log_range_bound == theirs.log_range_bound
        assert mine.end_rms == theirs.end_rms
        assert mine.advantage == theirs.advantage


def test_evaluation_seeds_lie_apart_from_training_seeds():
    from training.commands import EVALUATION_SEED

    default = evaluate(SHORT.override({"episode.steps": 4}), [Circle()], 2)
    assert default.seed == EVALUATION_SEED
    assert EVALUATION_SEED + 10**9 < 2**62


def test_normalised_error_counts_the_states_it_compares():
    """A tracker with acceleration states is judged on the four states that the emitter has too."""
    tracker = UnscentedKalman(motion=ConstantAcceleration(acceleration_noise=1e-3))
    scenario = SHORT.replace(tracker=tracker).override({"episode.decision_every": 1, "episode.steps": 12})
    policy = Circle()
    verdict = evaluate(scenario, [policy], 2, seed=4).verdicts[0]
    env = LocalisationEnv(scenario, overrides={"episode.early_end": False}, diagnostics=True)
    ratios = []
    for seed in (4, 5):
        observation, _ = env.reset(seed=seed)
        for _ in range(12):
            observation, *_, info = env.step(policy.act(observation[None], env.belief, np.random.default_rng(0))[0])
            error = info["estimate"][:4] - info["truth"][:4]
            ratios.append(error @ np.linalg.solve(info["covariance"][:4, :4], error) / 4.0)
    assert verdict.anees == pytest.approx(np.mean(ratios), rel=1e-6)


def test_file_is_valid_and_complete(evaluation, tmp_path):
    path = tmp_path / "results.json"
    path.write_text("something older", encoding="utf-8")
    evaluation.save(path)
    data = strictly(path.read_text(encoding="utf-8"))
    assert data == strictly(evaluation.to_json())
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]
    assert data.keys() == {"scenario", "episodes", "seed", "reference", "anees_band", "policies", "asked", "provenance"}
    assert Scenario.from_dict(data["scenario"]) == SHORT
    assert (data["episodes"], data["seed"], data["reference"]) == (EPISODES, 50, "circle")
    assert data["provenance"].keys() == {"command", "versions", "machine"}
    assert data["provenance"]["versions"]["numpy"] == np.__version__
    assert 0.0 < data["anees_band"][0] < 1.0 < data["anees_band"][1]
    for verdict, stored in zip(evaluation.verdicts, data["policies"], strict=True):
        assert stored.keys() == vars(verdict).keys()
        assert stored["policy"] == verdict.policy
        assert stored["log_range_bound"] == vars(verdict.log_range_bound)
        assert stored["end_error_percentiles"].keys() == {"p50", "p95", "p99"}


def test_file_stays_json_when_a_number_is_none(evaluation):
    """A track that ran away to infinity must not spoil the file for every reader that keeps to the standard."""
    verdict = evaluation.verdicts[0]
    kept = verdict.anees
    try:
        verdict.anees = float("inf")
        assert strictly(evaluation.to_json())["policies"][1]["policy"] == "straight"
    finally:
        verdict.anees = kept


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a", "b"], ["a", "b"]),
        (["a", "b", "a", "a"], ["a (1)", "b", "a (2)", "a (3)"]),
        (["a (1)", "a", "a"], None),
    ],
)
def test_equal_names_are_numbered(names, expected):
    """Whatever they are called, every policy keeps a verdict of its own."""
    policies = [Straight(name=name) if index else Circle(name=name) for index, name in enumerate(names)]
    evaluation = evaluate(SHORT.override({"episode.steps": 8}), policies, 3)
    found = [verdict.policy for verdict in evaluation.verdicts]
    assert found == expected or expected is None
    assert len(set(found)) == len(names) == len(evaluation.scores)
    assert evaluation.reference == found[0]
    first, second = (evaluation.scores[name].log_range_bound for name in found[:2])
    assert not np.array_equal(first, second)


def test_progress_counts_every_episode():
    seen = []
    evaluate(SHORT.override({"episode.steps": 4}), [Circle(), Straight()], 3, progress=lambda *what: seen.append(what))
    assert seen == [("circle", 3), ("straight", 3)]


def test_tables_hold_every_policy_best_first(evaluation):
    lines = markdown_table(evaluation).splitlines()
    assert len(lines) == 2 + len(evaluation.verdicts)
    columns = columns_of(evaluation)
    assert all(line.count("|") == len(columns) + 1 for line in lines)
    assert lines[0] == "| " + " | ".join(columns) + " |"
    order = [line.split("|")[1].strip() for line in lines[2:]]
    assert order == [verdict.policy for verdict in ranked(evaluation)]
    assert sorted(order) == sorted(verdict.policy for verdict in evaluation.verdicts)
    bounds = [float(line.split("|")[2].split("[")[0]) for line in lines[2:]]
    assert bounds == sorted(bounds)
    circle = next(line for line in lines if line.startswith("| circle "))
    assert f"{evaluation.verdicts[0].log_range_bound.value:.3f} [" in circle
    assert "seeds 50–73" in title(evaluation)
    assert "10 km" in notes(evaluation)


def test_the_paired_difference_stands_where_there_is_a_reference(evaluation):
    """Beside the headline, from the reference that the notes name; alone, a policy differs from nobody."""
    heading, _, *lines = (line.strip("| ").split(" | ") for line in markdown_table(evaluation).splitlines())
    column = heading.index("difference")
    assert heading[column - 1] == "log range bound"
    for line, verdict in zip(lines, ranked(evaluation), strict=True):
        mine, reference = (evaluation.scores[name].log_range_bound for name in (verdict.policy, "circle"))
        assert float(line[column].split(" [")[0]) == pytest.approx(np.mean(mine - reference), abs=5.1e-4)
    assert "Difference: log range bound minus that of circle, paired" in notes(evaluation)
    alone = evaluate(SHORT, [Circle()], 4)
    assert list(columns_of(alone)) == list(COLUMNS)
    assert "Difference" not in notes(alone)


def test_errors_are_also_in_metres(evaluation):
    """Three digits of the median, whatever its size."""
    heading, _, *lines = markdown_table(evaluation).splitlines()
    column = heading.split(" | ").index("end error, m")
    for line, verdict in zip(lines, ranked(evaluation), strict=True):
        shown = float(line.split(" | ")[column].split(" [")[0])
        assert shown == pytest.approx(verdict.end_position_error.value, rel=5e-3)


@pytest.fixture(scope="module")
def crossing():
    """Vehicles whose reward counts metres, under noise that is uniform."""
    scenario = SCENARIOS["CrossFix"].override({"episode.steps": 20})
    return evaluate(scenario, [find_policy(name, scenario) for name in ("straight", "fly-at", "circle")], EPISODES)


def test_what_the_reward_counts_decides_the_order(evaluation, crossing):
    """Vehicles that near the emitter must not look worse for their shorter range."""
    metres = [verdict.end_position_error.value for verdict in ranked(crossing)]
    assert metres == sorted(metres)
    bounds = [verdict.log_range_bound.value for verdict in ranked(crossing)]
    assert bounds != sorted(bounds)
    words = notes(crossing)
    assert "Sorted by the end error in metres" in words
    assert "over the range of platform 0" in words
    assert "Uniform noise has no such bound" in words
    for absent in ("Sorted", "platform", "Uniform"):
        assert absent not in notes(evaluation)


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_terminal_table_fits_its_terminal(evaluation, width):
    """No name and no number is cut; what has no room is said, and not explained."""
    output = io.StringIO()
    Console(width=width, file=output).print(rich_table(evaluation, width))
    text = output.getvalue()
    assert all(len(line) <= width for line in text.splitlines())
    assert "…" not in text
    assert all(verdict.policy in text for verdict in evaluation.verdicts)
    assert f"{evaluation.verdicts[0].log_range_bound.value:.3f}" in text
    words = " ".join(text.split())
    hidden = words.split("No room for ")[1].split(":")[0].split("; ") if "No room for" in words else []
    assert bool(hidden) == (width < 200)
    assert ("ANEES per state" in words) == ("ANEES" not in hidden)
    columns = columns_of(evaluation)
    shown = [name for name in list(columns)[2:] if name not in hidden]
    assert ("minus that of circle" in words) == ("difference" in shown) == (width >= 60)
    assert ("violations, %" in shown) == (width >= 80)
    for verdict in evaluation.verdicts:
        assert all(columns[name](verdict).split(" [")[0] in text for name in shown)


def test_names_of_policies_are_never_cut():
    """Broken between words at most: here the table is as wide as the terminal."""
    scenario = SCENARIOS["BearingsOnly"].override({"episode.steps": 8})
    found = evaluate(scenario, [find_policy(name, scenario) for name in ("perpendicular", "zigzag:angle=60")], 8)
    for width in range(40, 120):
        output = io.StringIO()
        Console(width=width, file=output).print(rich_table(found, width))
        assert "perpendicular" in output.getvalue()
        assert "…" not in output.getvalue()
