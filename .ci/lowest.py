"""Print the lowest versions that pyproject.toml allows: of the core, and of the extras named on the command line."""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def lowest(extras: list[str]) -> list[str]:
    """Requirements with == in place of >=."""
    wanted = list(PROJECT["dependencies"])
    for extra in extras:
        wanted += PROJECT["optional-dependencies"][extra]
    return [re.sub(r">=", "==", requirement) for requirement in wanted]


if __name__ == "__main__":
    print("\n".join(lowest(sys.argv[1:])))
