"""Compare pinned versions with known advisories: ``python .ci/audit.py constraints.txt [FOLDER]``.

FOLDER holds advisories as OSV publishes them, one JSON file each, for instance the unpacked archive of its PyPI
ecosystem. Without one the audit is skipped and says so, and a FOLDER that holds none is an error: neither passes for
done.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

SKIPPED = "NOTICE: no stored advisories: the audit of {count} pinned versions is skipped"


def pins(path: Path) -> dict[str, Version]:
    """The pinned versions of a constraints file by canonical name."""
    found = re.findall(r"^([A-Za-z0-9_.\-]+)==(\S+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {canonicalize_name(name): Version(version) for name, version in found}


def advisories(folder: Path) -> Iterator[dict[str, Any]]:
    """All advisories of a folder that have not been withdrawn."""
    for path in sorted(folder.rglob("*.json")):
        advisory = json.loads(path.read_text(encoding="utf-8"))
        if not advisory.get("withdrawn"):
            yield advisory


def concerned(advisory: dict[str, Any], pinned: dict[str, Version]) -> Iterator[str]:
    """What an advisory has to say about the pinned versions."""
    for affected in advisory.get("affected", ()):
        package = affected.get("package", {})
        version = pinned.get(canonicalize_name(package.get("name", "")))
        if package.get("ecosystem") != "PyPI" or version is None:
            continue
        if _listed(version, affected.get("versions", ())) or any(map(_within(version), affected.get("ranges", ()))):
            yield f"{package['name']} {version}: {advisory['id']} {advisory.get('summary', '')}".strip()


def _listed(version: Version, texts: Iterable[str]) -> bool:
    """Whether a version is among those that an advisory lists, however it spells them."""
    return any(_version(text) == version for text in texts)


def _within(version: Version) -> Callable[[dict[str, Any]], bool]:
    """Whether a version lies in a range of an advisory: from where it was introduced to where it was fixed.

    Where an end of the range is no version, nobody can tell, and the version counts as concerned.
    """

    def within(span: dict[str, Any]) -> bool:
        if span.get("type") != "ECOSYSTEM":
            return False
        events = [(_version(text), kind) for event in span.get("events", ()) for kind, text in event.items()]
        if any(place is None for place, _ in events):
            return True
        inside = False
        for place, kind in sorted(events):
            if kind == "introduced" and version >= place:
                inside = True
            elif (kind == "fixed" and version >= place) or (kind == "last_affected" and version > place):
                inside = False
        return inside

    return within


def _version(text: str) -> Version | None:
    try:
        return Version(text)
    except InvalidVersion:
        return None


def main(constraints: str, folder: str = "") -> int:
    """Print what is known against the pinned versions; 1 if there is anything, 2 if the folder holds no advisory."""
    pinned = pins(Path(constraints))
    if not folder:
        print(SKIPPED.format(count=len(pinned)))
        return 0
    stored = list(advisories(Path(folder)))
    if not stored:
        print(f"folder = {folder!r} is not possible: it must hold advisories as .json files", file=sys.stderr)
        return 2
    findings = sorted({finding for advisory in stored for finding in concerned(advisory, pinned)})
    print("\n".join(findings) or f"{len(stored)} advisories say nothing against {len(pinned)} pinned versions")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
