"""What policies are ranked by."""

import math

import numpy as np
import pytest

pytest.importorskip("rich")

from agents import find_policy
from passloc_env import SCENARIOS
from training.evaluate import evaluate
from training.leaderboard.entrants import settings
from training.leaderboard.variants import variants
from training.score import END_ERROR, END_RMS, LOG_RANGE_BOUND, score_of
from training.table import columns_of, markdown_table, notes, ranked

BY_ERROR = {"OwnShipModerate": END_RMS, "OwnShipSevere": END_RMS, "CrossFix": END_ERROR}


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_the_reward_counts_ranks(name):
    assert score_of(SCENARIOS[name]) is BY_ERROR.get(name, LOG_RANGE_BOUND)


def test_the_optimum_minimises_what_ranks():
    objectives = {variant.name: settings(variant).objective for variant in variants("BearingsOnly,OwnShipModerate")}
    assert objectives["BearingsOnly"] == "log_range_bound"
    assert objectives["OwnShipModerate"] == objectives["OwnShipModerate-family"] == "end_position_bound"


@pytest.mark.parametrize("name", ["BearingsOnly", "OwnShipModerate", "CrossFix"])
def test_tables_are_sorted_by_a_column_that_they_have(name):
    """And the ranks are those of the figures themselves, of which the cost is the logarithm or the value."""
    scenario = SCENARIOS[name]
    policies = [find_policy(policy, scenario) for policy in ("circle", "straight", "fly-at", "perpendicular")]
    evaluation = evaluate(scenario, policies, 20, seed=40_000)
    score = score_of(scenario)
    heading, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in markdown_table(evaluation).splitlines()
    ]
    assert heading == list(columns_of(evaluation))
    shown = [float(row[heading.index(score.column)].split()[0]) for row in rows]
    assert shown == sorted(shown)
    assert (score.remark in notes(evaluation)) or not score.remark
    costs = [score.cost(evaluation.scores[verdict.policy]) for verdict in ranked(evaluation)]
    assert costs == sorted(costs)
    for verdict, cost in zip(ranked(evaluation), costs, strict=True):
        value = score.of(verdict).value
        assert cost == pytest.approx(value if score is LOG_RANGE_BOUND else math.log(value))


def test_the_rms_is_of_metres_and_shown_in_kilometres():
    scenario = SCENARIOS["OwnShipModerate"]
    evaluation = evaluate(scenario, [find_policy("circle", scenario)], 20, seed=40_000)
    (verdict,) = evaluation.verdicts
    errors = evaluation.scores["circle"].end_position_error
    assert END_RMS.of(verdict).value == pytest.approx(math.sqrt(np.mean(errors**2)))
    assert END_RMS.cell(verdict).value == pytest.approx(END_RMS.of(verdict).value / 1e3)
