"""Generated code for tests: written into folders, built by their own Makefiles, run."""

import shutil
import subprocess
from functools import cache

import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.python_targets import generate_python_module
from symid.codegen.source_folder import write_sources
from symid.options import GenerateOptions
from symid.robot import load_robot


def run(folder, *command, check=True, **options):
    """Run a program in a folder; with `check`, it ends well and complains of nothing."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, **options)
    assert not check or (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    return done


def make(folder, compiler, *targets, flags="", check=True):
    """Run the Makefile of a folder, or skip."""
    if shutil.which("make") is None:
        pytest.skip("wants make")
    given = [f"CFLAGS={flags}"] if flags else []
    return run(folder, "make", "-s", f"CC={compiler}", *given, *targets, check=check)


def list_failed(done):
    """Return the functions that failed a self-test."""
    return [line.split()[0] for line in done.stdout.splitlines() if line.endswith("FAILED")]


@cache
def build_shipped(name, *names, **options):
    """Return functions of a shipped robot: those of the names, or all."""
    return build_functions(load_robot(name), names=names or None, **options)


generate = cache(generate_c_library)


def write_c(functions, folder, **options):
    write_sources(generate(functions, GenerateOptions(**options)), folder)
    return folder


def write_python(functions, folder):
    write_sources(generate_python_module(functions), folder)
    return folder


def spoil(path, old, new):
    """Replace a text in a file, which must be there."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def write_program(path, text):
    """Write a script of the shell that can be called."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path
