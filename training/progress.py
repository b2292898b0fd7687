"""Progress bars that stay silent where nobody watches."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

console = Console(markup=False, emoji=False)
"""Where tables and bars go; colour only on a terminal, and every text as it is: paths and names may hold brackets."""


def progress_bar(unit: str, shown: bool = True) -> Progress:
    """A bar with elapsed and remaining time, shown only on a terminal."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not shown or console.quiet or not console.is_terminal,
        transient=True,
    )
