"""Calls of the command line in this process: what they answer, print, or refuse."""

import json
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

import numpy as np

from symid.cli.main import run


def call(*arguments):
    """Return exit code, what is printed, and what is said beside it."""
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run([*map(str, arguments)])
    return code, out.getvalue(), err.getvalue()


def ask(*arguments):
    """Return exit code and answer of a call with --json."""
    code, out, _ = call(*arguments, "--json")
    return code, json.loads(out)


def do(*arguments):
    """Return the answer of a call that must succeed."""
    code, answer = ask(*arguments)
    assert code == 0, answer.get("errors")
    return answer


def say(*arguments):
    """Return what a call prints that must succeed."""
    code, out, err = call(*arguments)
    assert code == 0, err
    return out


def fail(*arguments):
    """Return exit code, and the code of the first error, of a call that must fail."""
    code, answer = ask(*arguments)
    return code, answer["errors"][0]["code"]


def hear(exit_code, error, *arguments):
    """Return the text of the first error of a call that must fail with this exit code and code."""
    code, answer = ask(*arguments)
    first = answer["errors"][0]
    assert (code, first["code"]) == (exit_code, error), answer
    return first["text"]


def refuse(*arguments):
    """Return exit code, and the codes of all errors, of a call that must fail."""
    code, answer = ask(*arguments)
    return code, list_codes(answer, "errors")


def list_codes(answer, key="warnings"):
    """Return the codes of warnings, or of errors, in their order."""
    return [entry["code"] for entry in answer[key]]


def find_codes(answer):
    """Return the codes of all errors and warnings."""
    return {entry["code"] for key in ("errors", "warnings") for entry in answer.get(key, ())}


def find_texts(answer, code=""):
    """Return the texts of errors and warnings, or of those with a code, one after the other."""
    entries = [*answer.get("errors", ()), *answer.get("warnings", ())]
    return " ".join(entry["text"] for entry in entries if code in {"", entry["code"]})


def find_values(answer):
    """Return the values of a fit by the names of its parameters."""
    return {entry["name"]: entry["value"] for entry in answer["result"]["parameters"]}


def change_log(source, target, *, only=None, **changes):
    """Write the columns of a log to another file, `only` some, each after its change; return the path."""
    with np.load(source) as log:
        columns = {name: log[name] for name in only or log.files}
    np.savez(target, **columns | {name: change(columns[name]) for name, change in changes.items()})
    return target


def change_json(path, change, target=None):
    """Write what a JSON file holds, after a change, to `target` or back; return that path."""
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    target = target or path
    target.write_text(json.dumps(data), encoding="utf-8")
    return target
