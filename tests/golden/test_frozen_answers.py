"""Numbers stay where they were: every call of `freeze` answers as it did, number by number.

After a change of numbers that is meant, tests/golden/freeze.py --accept writes the answers anew.
"""

import copy
import json
import shlex
from contextlib import chdir

import pytest

from symid.cli.main import run
from tests.golden import freeze
from tests.golden.freeze import Scratch, compare, keep

SHOWN = 20


@pytest.fixture(scope="session")
def scratch(tmp_path_factory):
    """Return a folder of this worker: what one call writes is there for those that read it."""
    return Scratch(tmp_path_factory.mktemp("answers").resolve())


# The demo has a test file of its own.
@pytest.mark.parametrize("name", [name for name in freeze.CALLS if name != "demo"])
def test_an_answer_is_what_it_was(name, scratch, request, c_compiler):
    if freeze.wants_data(name):
        request.getfixturevalue("shared_data")
    differences = compare(freeze.read_answer(name), freeze.find_answer(name, scratch), name)
    assert not differences, "\n".join((f"{len(differences)} differences", *differences[:SHOWN]))


@pytest.mark.usefixtures("shared_data", "c_compiler")
def test_the_parameters_do_not_depend_on_the_generator(tmp_path, capsys):
    """Code that CasADi generated gives the parameters that our own code gives; see tests/recovery too."""
    with chdir(Scratch(tmp_path).folder):
        code = run([*shlex.split(freeze.CALLS["tx40-wls"]), "--backend", "casadi", "--json"])
    found = json.loads(capsys.readouterr().out)["result"]
    ours = freeze.read_answer("tx40-wls")["result"]
    assert (code, found["backend"]) == (0, "casadi")
    assert len(ours["parameters"]) > 10
    values, expected = ({e["name"]: e["value"] for e in one["parameters"]} for one in (found, ours))
    assert values == pytest.approx(expected, rel=1e-7)


STORED = {
    "ok": True,
    "count": 3,
    "text": "3 rows, 0.123456789012 N m",
    "rows": [{"value": 2.0, "std": 1e-20}, {"value": -3.0, "std": 0.5}],
    "long": keep([0.1 * k for k in range(freeze.LONGEST_LIST + 1)]),
}


def change(path, value):
    entry = changed = copy.deepcopy(STORED)
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = value
    return changed


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("ok",), 1),
        (("count",), 3.0),
        (("text",), "3 rows, 0.123456789512 N m"),
        (("text",), "3 rows, 0.123456789012 N"),
        (("rows", 0, "value"), 2.0 + 3e-9),
        (("rows", 0, "value"), None),
        (("rows", 0, "value"), float("nan")),
        (("rows", 0, "std"), 1e-12),
        (("rows",), STORED["rows"][:1]),
        (("long",), keep([0.1 * k for k in reversed(range(freeze.LONGEST_LIST + 1))])),
        (("more",), 0),
    ],
)
def test_what_differs_is_found(path, value):
    difference, *_ = compare(STORED, change(path, value))
    assert path == ("more",) or difference.startswith(".".join(map(str, path)))


def test_last_digits_are_no_difference_and_every_stored_answer_has_its_call():
    text = "3 rows,  0.123456789012001 N m"
    for path, value in ((("rows", 0, "value"), 2.0 + 1e-9), (("rows", 0, "std"), 4e-13), (("text",), text)):
        assert compare(STORED, change(path, value)) == []
    assert {path.stem for path in freeze.ANSWERS.iterdir()} == set(freeze.CALLS)
