"""`symid doctor`: what this installation has, what it lacks, and what to do about it."""

import sys

import click

import symid
from symid.cli.options import Verb, verb
from symid.cli.output import Answer, Console, make_answer

__all__ = ["command"]


@click.command("doctor", cls=Verb)
@verb
def command(console: Console) -> Answer:
    """Look at Python, packages, compiler, cache and shared files, and say what to do.

    Exit code 1 when something is missing that symid cannot work without.
    """
    console.detail(f"python: {sys.executable}")
    return make_answer(symid.doctor())
