"""The bill of materials: what symid runs on in this environment, as CycloneDX 1.6 (ECMA-424)."""

import importlib.metadata
import json
import re
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent


def normalise(name: str) -> str:
    """Return the name of a package as PEP 503 writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def list_packages(extras: Iterable[str] = ()) -> list[importlib.metadata.Distribution]:
    """Return the packages that symid and its extras need, directly or not, where they are installed."""
    settings = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    waiting = [*settings["dependencies"]]
    for extra in extras:
        waiting += settings["optional-dependencies"][extra]
    found = {}
    while waiting:
        # A marker other than of an extra names a package that is not installed where it does not hold.
        text = waiting.pop()
        name = re.match(r"[\w.-]+", text).group()
        if normalise(name) in found or "extra ==" in text:
            continue
        try:
            found[normalise(name)] = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        waiting += found[normalise(name)].requires or []
    return [found[name] for name in sorted(found)]


def list_licences(package: importlib.metadata.Distribution) -> list[dict[str, object]]:
    """Return the licence that a package states: an expression, or the name of a classifier or a text."""
    if stated := package.metadata.get("License-Expression"):
        return [{"expression": stated}]
    kinds = (entry.split(" :: ")[-1] for entry in package.metadata.get_all("Classifier") or ())
    named = [entry for entry in kinds if "License" in entry and entry != "License"]
    named = named or [(package.metadata.get("License") or "unknown").splitlines()[0]]
    return [{"license": {"name": name}} for name in named]


def build_bill(extras: Iterable[str] = ()) -> dict[str, object]:
    """Return the bill; it has no time, so that the same packages give the same text."""
    version = re.search(
        r'__version__ = "(.*)"', (PROJECT / "symid" / "__init__.py").read_text(encoding="utf-8")
    )
    components = [
        {
            "type": "library",
            "name": normalise(entry.name),
            "version": entry.version,
            "purl": f"pkg:pypi/{normalise(entry.name)}@{entry.version}",
            "licenses": list_licences(entry),
        }
        for entry in list_packages(extras)
    ]
    own = {
        "type": "library",
        "name": "symid",
        "version": version[1],
        "licenses": [{"license": {"id": "Apache-2.0"}}],
    }
    head = {"bomFormat": "CycloneDX", "specVersion": "1.6", "version": 1}
    return {**head, "metadata": {"component": own}, "components": components}


if __name__ == "__main__":
    json.dump(build_bill(sys.argv[1:]), sys.stdout, indent=1)
    sys.stdout.write("\n")
