"""The command that makes the leaderboard."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from training.arguments import at_least_one, check_seed
from training.commands import Leaderboard
from training.engines import Engine, opened
from training.episodes import fly_all
from training.evaluate import Evaluation, compare
from training.leaderboard.entrants import Entrant, entrants
from training.leaderboard.store import Store
from training.leaderboard.variants import Variant, variants
from training.progress import console, progress_bar


class Section(NamedTuple):
    """What a variant came to: who flew, notes on who could not, the evaluation."""

    variant: Variant
    entrants: list[Entrant]
    notes: list[str]
    evaluation: Evaluation


def leaderboard(arguments: Leaderboard) -> Path:
    """Fly what has not been flown, then write page and pictures; the page.

    Raises:
        InputError: an unknown scenario or policy, a policy that cannot fly one of the scenarios, impossible numbers.
        NotADirectoryError: a file where a folder is to be.
    """
    check_seed(arguments.seed)
    at_least_one(episodes=arguments.episodes)
    played = [(variant, *entrants(variant, arguments.policies)) for variant in variants(arguments.scenarios)]
    for folder in (arguments.out, arguments.cache):
        if folder.exists() and not folder.is_dir():
            raise NotADirectoryError(f"{folder} is not a folder: name another one")
        folder.mkdir(parents=True, exist_ok=True)
    store = Store(arguments.cache, arguments.episodes, arguments.seed)
    games = [(variant, entrant) for variant, found, _ in played for entrant in found]
    with opened(arguments.work) as engine:
        _fly(games, store, arguments.fresh, engine)
    sections = [Section(variant, found, notes, _judge(variant, found, store)) for variant, found, notes in played]

    from training.leaderboard.page import write

    for path in write(sections, arguments):
        console.print(f"{path}", highlight=False, soft_wrap=True)
    return arguments.out / "index.md"


def _fly(games: list[tuple[Variant, Entrant]], store: Store, fresh: bool, engine: Engine) -> None:
    """Fly whatever is not in the store, or all of it afresh; what has to be searched first, in this process."""
    if fresh:
        for variant, entrant in games:
            store.forget(variant, entrant)
    missing = [(variant, entrant) for variant, entrant in games if store.kept(variant, entrant) is None]
    console.print(f"{len(games)} results, {len(games) - len(missing)} of them kept from before", highlight=False)
    ready = [(variant, entrant, entrant.policy) for variant, entrant in missing if entrant.policy is not None]
    with progress_bar("episodes") as bar:
        task = bar.add_task("flying", total=store.episodes * len(missing))

        def advance(number: int, done: int) -> None:
            variant, entrant, _ = ready[number]
            bar.update(task, advance=done, description=f"{variant.name}: {entrant.name}")

        flights = [store.flight(variant, policy) for variant, _, policy in ready]
        for number, scores, seconds in fly_all(flights, advance, engine):
            store.keep(*ready[number][:2], scores, seconds)
        for variant, entrant in missing:
            if entrant.policy is None:
                bar.update(task, description=f"{variant.name}: {entrant.name}")
                store.flown(variant, entrant, lambda done: bar.advance(task, done))


def _judge(variant: Variant, found: list[Entrant], store: Store) -> Evaluation:
    """The evaluation of what the store holds."""
    results = {entrant.name: store.kept(variant, entrant) or store.flown(variant, entrant) for entrant in found}
    scores = {name: result[0] for name, result in results.items()}
    seconds = {name: result[1] for name, result in results.items()}
    return compare(variant.scenario, scores, seconds, store.seed)
