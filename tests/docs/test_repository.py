"""What a public repository says of itself agrees with the package."""

import re
import tomllib
from pathlib import Path

import symid

PROJECT = Path(__file__).resolve().parents[2]
SETTINGS = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))


def read(name):
    return (PROJECT / name).read_text(encoding="utf-8")


def test_every_dependency_has_its_licence_in_the_notice():
    optional = SETTINGS["project"]["optional-dependencies"]["hdf5"]
    names = [re.match(r"[\w-]+", text).group() for text in (*SETTINGS["project"]["dependencies"], *optional)]
    assert [name for name in names if name.lower() not in read("NOTICE").lower()] == []


def test_the_citation_is_of_this_version():
    assert f"\nversion: {symid.__version__}\n" in read("CITATION.cff")


def test_files_that_the_guide_names_are_there():
    named = re.findall(r"`((?:symid|tests|\.ci)/[\w./]+)`", read("CONTRIBUTING.md"))
    assert len(named) > 10
    assert [name for name in named if not (PROJECT / name).exists()] == []


def test_what_builds_the_package_is_pinned():
    pinned = dict(line.split("==") for line in read("constraints.txt").splitlines() if "==" in line)
    assert SETTINGS["build-system"]["requires"] == [f"hatchling=={pinned['hatchling']}"]


def test_the_workflow_runs_what_runs_here():
    assert "- run: .ci/run\n" in read(".github/workflows/ci.yml")
