"""The audit of dependencies finds what it should, and what is supported at least is what is declared."""

import importlib.util
import json
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


audit, lowest = script("audit"), script("lowest")


def advisory(name: str, events: list[dict[str, str]], **more: object) -> dict[str, object]:
    affected = {
        "package": {"ecosystem": "PyPI", "name": name},
        "ranges": [{"type": "ECOSYSTEM", "events": events}],
    }
    return {"id": "TEST-1", "summary": "it is bad", "affected": [affected], **more}


FIXED = [{"introduced": "0"}, {"fixed": "2.0"}]
LAST = [{"introduced": "1.0"}, {"last_affected": "1.5"}]
TWICE = [{"introduced": "1.0"}, {"fixed": "1.2"}, {"introduced": "1.4"}, {"fixed": "1.5"}]


@pytest.mark.parametrize(
    ("version", "events", "found"),
    [
        ("1.9", FIXED, True),
        ("2.0", FIXED, False),
        ("2.0rc1", FIXED, True),
        ("1.5", LAST, True),
        ("1.5.1", LAST, False),
        ("0.9", LAST, False),
        ("1.1", TWICE, True),
        ("1.3", TWICE, False),
        ("1.4", TWICE, True),
        ("1.10", TWICE, False),
    ],
)
def test_an_advisory_concerns_its_versions_alone(version, events, found, tmp_path, capsys):
    (tmp_path / "constraints.txt").write_text(f"# pins\nSome_Package=={version}\nother==1.0\n", encoding="utf-8")
    (tmp_path / "a.json").write_text(json.dumps(advisory("some-package", events)), encoding="utf-8")
    assert audit.main(str(tmp_path / "constraints.txt"), str(tmp_path)) == int(found)
    out = capsys.readouterr().out
    assert (f"some-package {version}: TEST-1 it is bad" in out) == found


def test_withdrawn_advisories_and_other_ecosystems_say_nothing(tmp_path, capsys):
    (tmp_path / "constraints.txt").write_text("mine==1.0\n", encoding="utf-8")
    gone = advisory("mine", FIXED, withdrawn="2026-01-01T00:00:00Z")
    elsewhere = advisory("mine", FIXED)
    elsewhere["affected"][0]["package"]["ecosystem"] = "npm"
    for number, each in enumerate((gone, elsewhere)):
        (tmp_path / f"{number}.json").write_text(json.dumps(each), encoding="utf-8")
    assert audit.main(str(tmp_path / "constraints.txt"), str(tmp_path)) == 0
    assert "1 advisories say nothing against 1 pinned versions" in capsys.readouterr().out


@pytest.fixture
def findings(tmp_path):
    """What an advisory that lies in a folder says against a version of ``mine``."""

    def found(said, version):
        (tmp_path / "a.json").write_text(json.dumps(said), encoding="utf-8")
        pinned = {"mine": audit.Version(version)}
        return [line for each in audit.advisories(tmp_path) for line in audit.concerned(each, pinned)]

    return found


UNREADABLE = [
    advisory("mine", [{"introduced": "0"}, {"fixed": "9.9.9-some.odd"}]),
    advisory("mine", [{"introduced": "0"}, {"last_affected": "the first"}]),
    advisory("mine", [{"introduced": "long ago"}, {"fixed": "2.0"}]),
]
NEVER_WITHDRAWN = advisory("mine", FIXED, withdrawn=None)
IN_ONE_EVENT = advisory("mine", [{"introduced": "0", "fixed": "2.0"}])


@pytest.mark.parametrize("said", [*UNREADABLE, NEVER_WITHDRAWN, IN_ONE_EVENT])
def test_whoever_may_be_concerned_counts_as_concerned(said, findings):
    assert findings(said, "1.0") == ["mine 1.0: TEST-1 it is bad"]


@pytest.mark.parametrize(("spelling", "found"), [("1.0", True), ("1.0.0", True), ("v1", True), ("1.0.1", False)])
def test_versions_are_compared_as_such(spelling, found, findings):
    listed = advisory("mine", [])
    listed["affected"][0]["versions"] = ["0.5", "not-a-version", spelling]
    assert bool(findings(listed, "1.0")) == found


def test_an_audit_without_advisories_says_that_it_is_skipped(capsys):
    assert audit.main(str(ROOT / "constraints.txt")) == 0
    assert capsys.readouterr().out.startswith("NOTICE: no stored advisories: the audit of ")


@pytest.mark.parametrize("folder", ["nowhere", "empty", "withdrawn"])
def test_a_folder_without_advisories_is_refused(folder, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "withdrawn").mkdir()
    gone = advisory("numpy", FIXED, withdrawn="2026-01-01T00:00:00Z")
    (tmp_path / "withdrawn" / "a.json").write_text(json.dumps(gone), encoding="utf-8")
    assert audit.main(str(ROOT / "constraints.txt"), str(tmp_path / folder)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    expected = f"folder = {str(tmp_path / folder)!r} is not possible: it must hold advisories as .json files\n"
    assert captured.err == expected


def test_every_dependency_is_pinned_within_its_bounds():
    from packaging.requirements import Requirement

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pinned = audit.pins(ROOT / "constraints.txt")
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(each for extra in extras.values() for each in extra)]
    for requirement in map(Requirement, wanted):
        version = pinned[audit.canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), requirement
        assert [each.operator for each in requirement.specifier] == [">="], requirement


def test_the_lowest_versions_are_single_ones_of_what_is_wanted():
    core, export = lowest.lowest([]), lowest.lowest(["export"])
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9.]+", each) for each in export)
    assert {each.partition("==")[0] for each in export} - {each.partition("==")[0] for each in core} == {
        "pyarrow",
        "stonesoup",
    }
    assert "numpy==2.1" in core


def test_no_torch_is_allowed_whose_reading_of_weights_alone_is_unsafe():
    """CVE-2026-24747 (GHSA-63cw-57p8-fm3p): ``weights_only=True`` does not protect before 2.10.0."""
    (torch,) = (each for each in lowest.lowest(["train"]) if each.startswith("torch=="))
    assert audit.Version(torch.removeprefix("torch==")) >= audit.Version("2.10.0")
