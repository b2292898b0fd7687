"""Compare pinned versions with known advisories: ``python .ci/audit.py constraints.txt [FOLDER]``.

FOLDER holds advisories as OSV publishes them, one JSON file each, for instance the unpacked archive of its PyPI
ecosystem. Without one, or when it holds none, the audit is skipped and says so; it never passes for done.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
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
        if "withdrawn" not in advisory:
            yield advisory


def concerned(advisory: dict[str, Any], pinned: dict[str, Version]) -> Iterator[str]:
    """What an advisory has to say about the pinned versions."""
    for affected in advisory.get("affected", ()):
        package = affected.get("package", {})
        version = pinned.get(canonicalize_name(package.get("name", "")))
        if package.get("ecosystem") != "PyPI" or version is None:
            continue
        if str(version) in affected.get("versions", ()) or any(map(_within(version), affected.get("ranges", ()))):
            yield f"{package['name']} {version}: {advisory['id']} {advisory.get('summary', '')}".strip()


def _within(version: Version) -> Any:
    """Whether a version lies in a range of an advisory: from where it was introduced to where it was fixed."""

    def within(span: dict[str, Any]) -> bool:
        if span.get("type") != "ECOSYSTEM":
            return False
        inside = False
        for event in sorted(span["events"], key=_place):
            kind, place = next(iter(event.items()))
            if kind == "introduced" and version >= _version(place):
                inside = True
            elif (kind == "fixed" and version >= _version(place)) or (
                kind == "last_affected" and version > _version(place)
            ):
                inside = False
        return inside

    return within


def _place(event: dict[str, str]) -> Version:
    return _version(next(iter(event.values())))


def _version(text: str) -> Version:
    try:
        return Version(text)
    except InvalidVersion:
        return Version("0")


def main(constraints: str, folder: str = "") -> int:
    """Print what is known against the pinned versions; 1 if there is anything."""
    pinned = pins(Path(constraints))
    stored = list(advisories(Path(folder))) if folder and Path(folder).is_dir() else []
    if not stored:
        print(SKIPPED.format(count=len(pinned)))
        return 0
    findings = sorted({finding for advisory in stored for finding in concerned(advisory, pinned)})
    print("\n".join(findings) or f"{len(stored)} advisories say nothing against {len(pinned)} pinned versions")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
