"""Judging policies: the same unseen episodes for all, with intervals, lost tracks and violations."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from agents import Policy
from passloc_env.errors import InputError, one_line, shown
from passloc_env.models import state_layout
from passloc_env.reading import json_data, read_text
from passloc_env.scenario import Scenario
from training.arguments import at_least_one, check_seed
from training.commands import EVALUATION_SEED
from training.engines import ALONE, Engine
from training.episodes import Flight, Scores, fly_all, fly_batch
from training.files import json_text, write_whole
from training.provenance import provenance
from training.results import Results, ScoresOnDisk, opened_results
from training.statistics import Asked, Bootstrap, Estimate, chi_square_band, rate, root_mean_square

_T = TypeVar("_T")


@dataclass
class Verdict:
    """One policy's scores over all episodes, each with its 95 % interval."""

    policy: str
    log_range_bound: Estimate
    advantage: Estimate
    """Log range bound minus the reference policy's, paired: negative is better."""
    end_error: Estimate
    """Median relative range error at the end."""
    end_position_error: Estimate
    """Median position error at the end, m."""
    end_error_percentiles: dict[str, float]
    mean_error: Estimate
    """Median over episodes of the relative range error averaged over time."""
    time_to_10: Estimate
    time_to_5: Estimate
    violations: Estimate
    lost: Estimate
    end_rms: Estimate
    """Root mean square position error at the end, m."""
    efficiency: float
    """RMS position error at the end over the RMS bound along the paths flown."""
    anees: float
    """Average NEES per state; 1 when consistent."""
    milliseconds_per_decision: float


@dataclass
class Evaluation:
    """Policies judged on the same episodes."""

    scenario: Scenario
    episodes: int
    seed: int
    reference: str
    verdicts: list[Verdict]
    anees_band: tuple[float, float]
    """95 % band of the ANEES of a consistent tracker, counting each episode's end as one sample."""
    scores: Mapping[str, Scores] = field(repr=False, default_factory=dict)
    asked: tuple[str, ...] = ()
    """What :func:`agents.find_policy` was asked for, policy by policy; empty where it was not."""
    origin: dict[str, Any] = field(repr=False, default_factory=lambda: provenance(sys.argv))
    """Command, versions, machine."""

    def to_dict(self) -> dict[str, Any]:
        """Everything but the per-episode scores, with where it came from."""
        return {
            "scenario": self.scenario.to_dict(),
            "episodes": self.episodes,
            "seed": self.seed,
            "reference": self.reference,
            "anees_band": list(self.anees_band),
            "policies": [dataclasses.asdict(verdict) for verdict in self.verdicts],
            "asked": list(self.asked),
            "provenance": self.origin,
        }

    def to_json(self) -> str:
        """:meth:`to_dict` as text."""
        return json_text(self.to_dict())

    def save(self, path: Path) -> None:
        """Write :meth:`to_json`; the file appears whole or not at all."""
        write_whole(path, self.to_json())


def read_evaluation(path: Path) -> Evaluation:
    """An evaluation that was saved; the scores of single episodes are not in it.

    Raises:
        InputError: it cannot be read, or is none.
    """
    try:
        data = json_data(read_text(path))
        low, high = data["anees_band"]
        evaluation = Evaluation(
            Scenario.from_dict(data["scenario"]),
            _of(int, data["episodes"]),
            _of(int, data["seed"]),
            _text(data["reference"]),
            [_verdict(entry) for entry in data["policies"]],
            (_number(low), _number(high)),
            asked=tuple(_text(word) for word in _of(list, data.get("asked", []))),
            origin=_of(dict, data["provenance"]),
        )
        at_least_one(episodes=evaluation.episodes)
        check_seed(evaluation.seed)
        if evaluation.reference not in [verdict.policy for verdict in evaluation.verdicts]:
            raise ValueError(f"its reference {shown(evaluation.reference)} is none of its policies")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a whole evaluation: {type(error).__name__}: {one_line(error)}") from None
    return evaluation


def _verdict(entry: dict[str, Any]) -> Verdict:
    fields = {field.name: _READERS[str(field.type)] for field in dataclasses.fields(Verdict)}
    return Verdict(**{name: read(entry[name]) for name, read in fields.items()})


def _of(kind: type[_T], value: Any) -> _T:
    """The value; TypeError unless it is just of a kind, for true is no 1."""
    if type(value) is not kind:
        raise TypeError(f"{shown(value)} must be {kind.__name__}")
    return value


def _text(value: Any) -> str:
    if not _of(str, value).isprintable():
        raise ValueError(f"{shown(value)} must be printable")
    return str(value)


def _number(value: Any) -> float:
    """A float; null stands for what was not a finite number."""
    return math.nan if value is None else float(value) if type(value) is int else _of(float, value)


def _numbers(values: Any) -> dict[str, float]:
    return {_text(name): _number(value) for name, value in values.items()}


_READERS: dict[str, Callable[[Any], Any]] = {
    "str": _text,
    "float": _number,
    "dict[str, float]": _numbers,
    "Estimate": lambda value: Estimate(**_numbers(value)),
}
"""How each type of a verdict's fields is made from plain data."""


def evaluate(
    scenario: Scenario,
    policies: Sequence[Policy],
    episodes: int = 512,
    seed: int = EVALUATION_SEED,
    progress: Callable[[str, int], None] = lambda policy, done: None,
    engine: Engine = ALONE,
    folder: Path | None = None,
) -> Evaluation:
    """Fly every policy through the same episodes and compare.

    Args:
        scenario: the problem.
        policies: who decides; the first is the reference of the paired differences.
        episodes: how many, with seeds ``seed, seed + 1, …``.
        seed: of the first episode.
        progress: called with a policy's name and the number of its episodes just finished.
        engine: where they are flown.
        folder: where the scores of every episode are kept as they come; what is there is not flown again, and the
            scores are read from there whenever they are needed. By default they are kept in memory.

    Raises:
        InputError: fewer than one episode, a negative seed, or a folder that cannot be used.
    """
    at_least_one(episodes=episodes)
    check_seed(seed)
    names = unique([policy.name for policy in policies])
    if folder is not None:
        with opened_results(folder, scenario, names, policies, episodes, seed) as results:
            _fly_missing(results, scenario, dict(zip(names, policies, strict=True)), progress, engine)
            seconds = {name: results.seconds(name) for name in names}
            return compare(scenario, ScoresOnDisk(results), seconds, seed)
    flights = [Flight(scenario, policy, episodes, seed) for policy in policies]
    flown: dict[str, tuple[Scores, float]] = {}
    for number, of_all, thinking in fly_all(flights, lambda number, done: progress(names[number], done), engine):
        flown[names[number]] = of_all, thinking
    scores = {name: flown[name][0] for name in names}
    return compare(scenario, scores, {name: flown[name][1] for name in names}, seed)


def _fly_missing(
    results: Results,
    scenario: Scenario,
    policies: Mapping[str, Policy],
    progress: Callable[[str, int], None],
    engine: Engine,
) -> None:
    """Fly the batches that are not kept yet, and keep each as it comes."""
    missing = []
    for name in policies:
        for first, count in results.batches:
            if results.path(name, first).exists():
                progress(name, count)
            else:
                missing.append((name, first, count))
    tasks = [(scenario, policies[name], results.seed, first, count) for name, first, count in missing]
    for task, (scores, seconds) in engine.map(fly_batch, tasks):
        name, first, count = missing[task]
        results.keep(name, first, scores, seconds)
        progress(name, count)


def compare(
    scenario: Scenario, scores: Mapping[str, Scores], seconds: Mapping[str, float], seed: int = EVALUATION_SEED
) -> Evaluation:
    """The evaluation that follows from episodes flown now or earlier.

    Args:
        scenario: the problem.
        scores: of each policy by its name, all on the same episodes; the first is the reference.
        seconds: per decision, what each policy took.
        seed: of the first episode.
    """
    names = list(scores)
    reference = scores[names[0]]
    episodes = len(reference.log_range_bound)
    bootstrap = Bootstrap(episodes)
    tracked, true = (state_layout(scenario, motion) for motion in (scenario.tracker.motion, scenario.target.motion))
    states = len(tracked.shared_rows(true))
    verdicts = [_judge(name, scores[name], reference, seconds[name], states, bootstrap) for name in names]
    band = chi_square_band(states * episodes)
    return Evaluation(scenario, episodes, seed, names[0], verdicts, band, scores)


def _judge(name: str, scores: Scores, reference: Scores, seconds: float, states: int, bootstrap: Bootstrap) -> Verdict:
    asked = {
        "log_range_bound": Asked(lambda: scores.log_range_bound),
        "advantage": Asked(lambda: scores.log_range_bound - reference.log_range_bound),
        "end_error": Asked(lambda: scores.end_error, np.median),
        "end_position_error": Asked(lambda: scores.end_position_error, np.median),
        "mean_error": Asked(lambda: scores.mean_error, np.median),
        "time_to_10": Asked(lambda: scores.time_to_10),
        "time_to_5": Asked(lambda: scores.time_to_5),
        "end_rms": Asked(lambda: scores.end_position_error, root_mean_square),
    }
    estimates = dict(zip(asked, bootstrap.estimates(list(asked.values())), strict=True))
    percentiles = np.percentile(scores.end_error, [50, 95, 99])
    rms_bound = root_mean_square(scores.end_position_bound)
    return Verdict(
        policy=name,
        **estimates,
        end_error_percentiles=dict(zip(("p50", "p95", "p99"), map(float, percentiles), strict=True)),
        violations=rate(scores.violated),
        lost=rate(scores.lost),
        efficiency=float(estimates["end_rms"].value / rms_bound),
        anees=float(np.mean(scores.mean_nees)) / states,
        milliseconds_per_decision=1e3 * seconds,
    )


def unique(names: list[str]) -> list[str]:
    """Names made different by numbering the repeated ones."""
    unique: list[str] = []
    for index, name in enumerate(names):
        number = names[:index].count(name) + 1
        candidate = name if names.count(name) == 1 else f"{name} ({number})"
        while candidate in unique:
            number += 1
            candidate = f"{name} ({number})"
        unique.append(candidate)
    return unique
