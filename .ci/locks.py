"""Write `.ci/locks`: versions and hashes of what the environments of the Makefile are made from.

One file an environment, good for every Python from the oldest that symid supports. Versions of an earlier
lock stay as long as they fit; name packages on the command line to have their newest versions.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
LOCKS = PROJECT / ".ci" / "locks"
SETTINGS = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
ENVIRONMENTS = {"dev": ("dev", "docs"), "core": (), "docs": ("docs",)}
"""Extras of each environment. The first one holds all, so that the others have the same versions."""
# axe-core, the rules for pages that everybody can read, comes with a package of which nothing else is used.
# What dask-jobqueue needs is in dev already.
APART = {
    "axe": ("axe-playwright-python==0.1.8", "--no-deps"),
    "slurm": ("dask-jobqueue", "--no-deps"),
    "tools": ("pip-audit\nuv",),
}
"""Requirements and options of what is installed into an environment besides, or for one target only."""
OLDEST = SETTINGS["project"]["requires-python"].removeprefix(">=")


def lock(name: str, wanted: str, *options: str) -> None:
    """Write one lock from requirements, a line each."""
    target = LOCKS / f"{name}.txt"
    command = [str(Path(sys.executable).parent / "uv"), "pip", "compile", "-", "--output-file", str(target)]
    command += ["--universal", "--python-version", OLDEST, "--generate-hashes", "--no-annotate", "--quiet"]
    command += ["--custom-compile-command", "make locks", *options]
    subprocess.run(command, input=wanted, text=True, check=True, cwd=PROJECT)


def main() -> None:
    """Write all locks."""
    LOCKS.mkdir(exist_ok=True)
    newer = [option for name in sys.argv[1:] for option in ("--upgrade-package", name)]
    # Both builds of symid, editable ones and wheels, are made by what is locked.
    build = [*SETTINGS["build-system"]["requires"], "editables"]
    same = ("--constraint", str(LOCKS / "dev.txt"))
    for name, extras in ENVIRONMENTS.items():
        wanted = [*SETTINGS["project"]["dependencies"], *build]
        for extra in extras:
            wanted += SETTINGS["project"]["optional-dependencies"][extra]
        lock(name, "\n".join(wanted), *newer, *(() if name == "dev" else same))
    for name, (wanted_alone, *options) in APART.items():
        lock(name, wanted_alone, *newer, *same, *options)


if __name__ == "__main__":
    main()
