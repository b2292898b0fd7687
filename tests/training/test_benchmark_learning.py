"""The learning benchmark with tiny settings: structure and arithmetic, never speed."""

import dataclasses
import io
import json

import pytest
import torch
from rich.console import Console

from passloc_env import SCENARIOS, Scenario
from training import benchmark
from training.answer import plain
from training.benchmark import Bench, learning, report
from training.benchmark.learning import Plan, Turn, measure_learning
from training.files import json_text

SCENARIO = SCENARIOS["BearingsOnly"].override({"episode.steps": 24})
TINY = Plan(environments=4, steps=4, peer_environments=2, peer_steps=3, batch=8, epochs=1, layers=(4,))


@pytest.mark.parametrize("plan", [TINY, dataclasses.replace(TINY, peer_steps=8)])
def test_both_sides_learn(plan: Plan) -> None:
    threads = torch.get_num_threads()
    found = measure_learning(SCENARIO, 2, plan)
    assert torch.get_num_threads() == threads
    assert (found.rollout, found.batch, found.epochs, found.rounds) == (16, 8, 1, 2)
    assert [learner.environments for learner in found.learners] == [4, 2]
    for learner in found.learners:
        assert learner.per_second.low > 0.0
        assert learner.per_second.median < learner.collecting.high
        assert 0.0 < learner.share.low <= learner.share.high < 1.0
    assert found.ratio.low > 0.0
    put_together = any("put together" in note for note in found.notes)
    assert put_together == (not plan.whole)
    updates = [learner.updating for learner in found.learners]
    assert (updates[0] == updates[1]) == (not plan.whole)


def test_rate_of_a_turn() -> None:
    assert Turn(collecting=0.01, updating=3.0).per_second(100) == pytest.approx(100 / (1.0 + 3.0))


def test_the_default_rollout_is_a_whole_number_of_batches() -> None:
    plan = Plan()
    assert plan.rollout % plan.batch == 0
    assert dataclasses.replace(plan, peer_steps=1024).whole


def test_bench_includes_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, int, Plan]] = []

    def tiny(scenario: Scenario, rounds: int, plan: Plan) -> report.Learning:
        asked.append((scenario.name, rounds, plan))
        return measure_learning(SCENARIO, rounds, TINY)

    monkeypatch.setattr(learning, "measure_learning", tiny)
    results = benchmark.measure(
        Bench(sizes=(), rounds=1, seconds=0.001, workers=1, peers=False, growth=False, trackers=False)
    )
    best = Plan(environments=256, steps=60, batch=1024, epochs=4, layers=(128, 128))
    assert asked == [("BearingsOnly", 1, Plan()), ("BearingsOnly", 1, best)]
    assert [each["ratio"]["median"] > 0.0 for each in json.loads(json_text(plain(results)))["learning"]] == [True, True]
    console = Console(file=io.StringIO(), width=120)
    report.show(results, console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "end to end" in text
