"""What a public repository says of itself agrees with the package."""

import importlib.metadata
import json
import re
import runpy
import tomllib
from pathlib import Path

import symid

PROJECT = Path(__file__).resolve().parents[2]
SETTINGS = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))


def read(name):
    return (PROJECT / name).read_text(encoding="utf-8")


LOCKS = sorted((PROJECT / ".ci" / "locks").glob("*.txt"))
MATERIALS = runpy.run_path(str(PROJECT / ".ci" / "materials.py"))
IMPORTED = ("hdf5", "parquet", "ros", "cluster", "questions", "xacro")
"""Extras that users install; the others are of tests and documentation, or of other programs."""
PERMISSIVE = {"BSD-3-Clause", "BSD-2-Clause", "MIT", "Apache-2.0", "PSF-2.0", "any-OSI"}


def test_every_package_that_symid_runs_on_has_its_licence_in_the_notice():
    listed = dict(re.findall(r"^    ([\w.]+) +([\w. -]+?)(?: *\(.*)?$", read("NOTICE"), re.MULTILINE))
    listed = {MATERIALS["normalise"](name): licence.strip() for name, licence in listed.items()}
    found = MATERIALS["list_packages"](IMPORTED)
    assert [entry.name for entry in found if MATERIALS["normalise"](entry.name) not in listed] == []
    wrong = {}
    for entry in found:
        here = listed[MATERIALS["normalise"](entry.name)]
        if here not in PERMISSIVE and here != "Apache-2.0 OR BSD-2-Clause" and entry.name.lower() != "casadi":
            wrong[entry.name] = here
        # NumPy's expression has those of the code that it carries.
        stated = entry.metadata.get("License-Expression")
        if stated and here not in {stated, stated.split(" AND ")[0], "MIT"}:
            wrong[entry.name] = (here, stated)
    assert wrong == {}


def test_the_bill_of_materials_names_versions_and_licences():
    bill = MATERIALS["build_bill"](IMPORTED)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    assert bill["metadata"]["component"]["version"] == symid.__version__
    named = {entry["name"]: entry for entry in bill["components"]}
    assert named["numpy"]["purl"] == f"pkg:pypi/numpy@{importlib.metadata.version('numpy')}"
    assert [name for name, entry in named.items() if not entry["licenses"]] == []
    assert json.dumps(bill) == json.dumps(MATERIALS["build_bill"](IMPORTED))


def test_the_citation_is_of_this_version():
    assert f"\nversion: {symid.__version__}\n" in read("CITATION.cff")


def test_files_that_the_guide_names_are_there():
    named = re.findall(r"`((?:symid|tests|\.ci)/[\w./]+)`", read("CONTRIBUTING.md"))
    assert len(named) > 10
    assert [name for name in named if not (PROJECT / name).exists()] == []


def read_lock(name):
    """Return version and hashes of each package of a lock; a line says no more than that."""
    found = {}
    text = read(f".ci/locks/{name}.txt").replace("\\\n", "")
    for line in filter(None, (line for line in text.splitlines() if not line.startswith("#"))):
        package, version, rest = re.fullmatch(
            r"([\w.-]+)==(\S+)(?: ; [^#]*?)?((?: +--hash=\S+)+)", line
        ).groups()
        found[MATERIALS["normalise"](package)] = (version, tuple(rest.split()))
    return found


def test_locks_name_all_that_environments_need_in_one_version_with_hashes():
    project, locks = SETTINGS["project"], {path.stem: read_lock(path.stem) for path in LOCKS}
    assert {"core", "dev", "docs"} < set(locks)
    for name, lock in locks.items():
        assert all(re.fullmatch(r"(--hash=sha256:[0-9a-f]{64})+", "".join(kept)) for _, kept in lock.values())
        assert not [one for one in lock if locks["dev"].get(one, lock[one]) != lock[one]], name
    for name, extras in {"core": (), "dev": ("dev", "docs"), "docs": ("docs",)}.items():
        wanted = [*project["dependencies"], *SETTINGS["build-system"]["requires"]]
        wanted += [line for extra in extras for line in project["optional-dependencies"][extra]]
        direct = {MATERIALS["normalise"](re.match(r"[\w.-]+", line).group()) for line in wanted}
        assert direct - set(locks[name]) == set(), "run `make locks`"
    assert SETTINGS["build-system"]["requires"] == [f"hatchling=={locks['core']['hatchling'][0]}"]


def test_the_workflow_runs_what_runs_here():
    assert "- run: .ci/run\n" in read(".github/workflows/ci.yml")
