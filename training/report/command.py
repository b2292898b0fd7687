"""The command that makes a report."""

from __future__ import annotations

from pathlib import Path

from passloc_env.errors import InputError
from passloc_env.scenarios import SCENARIOS
from training.arguments import at_least_one, free_path
from training.commands import Report
from training.evaluate import Evaluation
from training.progress import console
from training.replay import record
from training.report import charts
from training.report.errors import EPISODES, error_curves
from training.report.page import Chart, Page, write_report
from training.report.player import played
from training.report.subject import Subject, configuration, read_subject
from training.scenario_words import summary
from training.score import score_of
from training.table import columns_of, notes, ranked, title, with_interval


def report(arguments: Report) -> Path:
    """Read a run or an evaluation, fly what is to be shown, and write the page, which is returned.

    Raises:
        InputError: neither a run nor an evaluation, a damaged one, or a page that does not end as one.
        OSError: a place that cannot be written into; told before anything is flown.
    """
    at_least_one(episodes=arguments.episodes)
    if arguments.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"out = {str(arguments.out)!r} is not possible: must end in .html")
    free_path(arguments.out)
    page = report_page(read_subject(arguments.source, arguments.episodes))
    write_report(page, arguments.out)
    console.print(f"    {arguments.out}", highlight=False, soft_wrap=True)
    return arguments.out


def report_page(subject: Subject) -> Page:
    """Everything that a subject has to show."""
    evaluation, shown = subject.evaluation, subject.shown()
    page = Page(
        title=f"{subject.scenario.name}: {_headline(evaluation)}",
        lead=[*_lead(subject), *subject.remarks],
        table=_table(evaluation),
        configuration=configuration(subject),
        command=str(evaluation.origin.get("command", "")),
    )
    score = score_of(subject.scenario)
    words = f"{score.column.capitalize()} of every policy with its 95 % interval; lower is better."
    page.charts.append(Chart("scores", "How far apart they are", words, charts.scores(evaluation)))
    words = "Episodes that came too near the emitter, and episodes whose track was lost, with 95 % intervals."
    page.charts.append(Chart("rates", "Violations and lost tracks", words, charts.rates(evaluation)))
    if subject.curve is not None and len(subject.curve["decisions"]):
        words = "Mean return and violations of the episodes that ended in each rollout of the training."
        page.charts.append(Chart("learning", "Learning", words, charts.learning(subject.curve)))
    if shown:
        flown = {name: record(subject.scenario, policy, evaluation.seed) for name, policy in shown.items()}
        page.player = played(subject.scenario, flown, evaluation.seed)
        episodes = min(EPISODES, evaluation.episodes)
        words = (
            f"Medians over {episodes} of the episodes, the middle half of the errors shaded. Dashed: the median error "
            "of an estimate as good as the Cramér–Rao bound on the range, 0.674 of it. Where the tracker is efficient "
            "the two run together."
        )
        figure = charts.errors(error_curves(subject.scenario, shown, episodes, evaluation.seed))
        page.charts.append(Chart("errors", "Error against bound", words, figure, before=False))
    return page


def _headline(evaluation: Evaluation) -> str:
    """How many policies were judged on how many episodes."""
    policies, episodes = len(evaluation.verdicts), evaluation.episodes
    return f"{policies} {'policy' if policies == 1 else 'policies'}, {episodes} unseen episode{'s' * (episodes > 1)}"


def _lead(subject: Subject) -> list[str]:
    """What the scenario is about, and how the reference compares with the best of the others."""
    evaluation, scenario = subject.evaluation, subject.scenario
    score = score_of(scenario)
    known = SCENARIOS.get(scenario.name)
    lines = [summary(known)] if known is not None and known == scenario else []
    others = [verdict for verdict in ranked(evaluation) if verdict.policy != evaluation.reference]
    own = next(verdict for verdict in evaluation.verdicts if verdict.policy == evaluation.reference)
    said = f"{own.policy}: {score.column} {with_interval(score.cell(own), score.digits)}"
    if others:
        said += f"; the best of the others, {others[0].policy}: {with_interval(score.cell(others[0]), score.digits)}"
    return [*lines, f"{said}. Lower is better; brackets are 95 % intervals."]


def _table(evaluation: Evaluation) -> dict[str, object]:
    columns = columns_of(evaluation)
    headings = list(columns)
    return {
        "title": title(evaluation),
        "headings": headings,
        "sorted": headings.index(score_of(evaluation.scenario).column),
        "rows": [[write(verdict) for write in columns.values()] for verdict in ranked(evaluation)],
        "notes": notes(evaluation),
    }
