"""Tables in Markdown, as the pages that are generated have them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

LEFT, RIGHT = ":--", "--:"


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]], others: str = LEFT) -> str:
    """A table without a last line end.

    Args:
        headings: of its columns; the first one stands to the left.
        rows: of cells.
        others: where the other columns stand: ``LEFT`` for words, ``RIGHT`` for numbers.
    """
    lines = [headings, [LEFT] + [others] * (len(headings) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
