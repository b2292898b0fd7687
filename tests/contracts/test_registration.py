"""The ids are there whenever Gymnasium is, whoever was imported first."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MADE = "gymnasium.make('passloc/BearingsOnly-v0'); print(sum('passloc/' in name for name in gymnasium.registry))"
BROKEN = (
    "import sys, passloc_env, numpy; hidden = sys.modules.pop('numpy'); sys.modules['numpy'] = None\n"
    "try:\n    import gymnasium\nexcept ImportError:\n    sys.modules['numpy'] = hidden\n"
    "else:\n    raise SystemExit('it should have failed')\n"
    "[sys.modules.pop(name) for name in list(sys.modules) if name.startswith('gymnasium')]\nimport gymnasium\n"
)


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium, passloc_env",
        "import passloc_env, gymnasium",
        "import passloc_env; from gymnasium.vector import VectorEnv; import gymnasium",
        "import passloc_env, importlib.util; importlib.util.find_spec('gymnasium'); import gymnasium",
        "import passloc_env, pkgutil; list(pkgutil.iter_modules()); import gymnasium",
        "import importlib, passloc_env; importlib.reload(passloc_env); import gymnasium",
        "import gymnasium; gymnasium.make('passloc_env:passloc/BearingsOnly-v0')",
        BROKEN,
    ],
)
def test_ids_are_registered(code: str) -> None:
    told = "print([type(finder).__name__ for finder in sys.meta_path if 'passloc' in type(finder).__module__])"
    script = f"{code}\nimport sys\n{MADE}\n{told}\nprint(type(gymnasium.__spec__.loader).__module__)"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # All of them, nobody waits any more, and Gymnasium does not know that anybody did.
    assert done.stdout.split() == ["14", "[]", "_frozen_importlib_external"]
