"""What is printed is what was said: paths and names may hold what rich would take for markup."""

from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from training.progress import console, progress_bar

STRANGE = ("agent[v2]", "runs[/bold]", "[red]x", ":smile:")


@pytest.mark.parametrize("name", STRANGE)
def test_names_are_printed_as_they_are(name: str) -> None:
    table = Table("policy", title=f"title {name}")
    table.add_row(f"cell {name}")
    with console.capture() as captured:
        console.print(f"line {name}", highlight=False, soft_wrap=True)
        console.print(table)
    assert all(f"{what} {name}" in captured.get() for what in ("line", "title", "cell"))


@pytest.mark.parametrize("name", STRANGE[:3])
def test_bars_name_what_they_are_about(name: str) -> None:
    bar = progress_bar("decisions")
    task = bar.add_task(f"training on {name}", total=1)
    plain = Console(width=200)
    with plain.capture() as captured:
        plain.print(bar.make_tasks_table([bar.tasks[task]]))
    assert f"training on {name}" in captured.get()


@pytest.mark.usefixtures("logs_of_its_own")
@pytest.mark.parametrize("name", ["agent[v2]", "runs[bold]x[/red]"])
def test_a_training_says_where_its_agent_is(name: str, passloc: Callable[..., tuple[int, str, str]]) -> None:
    pytest.importorskip("stable_baselines3")
    Path("tiny.yaml").write_text(
        "{decisions: 64, environments: 4, rollout: 16, batch_size: 64, epochs: 1, network: [8]}", encoding="utf-8"
    )
    status, out, _ = passloc("train", "--hyperparameters", "tiny.yaml", "--out", name)
    assert status == 0
    assert out.endswith(f"the agent is in {name}\n")
    assert (Path(name) / "agent.json").is_file()
