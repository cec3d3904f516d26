"""JavaScript of the catalogue in Node against compiled C, at a hundred states."""

import json
import shutil
import subprocess

import numpy as np
import pytest

import symid
from symid.codegen.printing import print_javascript
from symid.codegen.programs import ExpressionTable, Op
from symid.lessons.chapters import build_values
from symid.lessons.matrices import build_model
from tests.sx_programs import make_spec

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="Node is not here: apt-get install nodejs")
STATES = 100
RUN = """
import * as robot from "./%s.mjs";
import { readFileSync, writeFileSync } from "node:fs";
const given = JSON.parse(readFileSync("given.json", "utf8")), found = {};
for (const [name, samples] of Object.entries(given)) {
  found[name] = samples.map((inputs) => {
    const value = robot[name](...inputs);
    const ports = value instanceof Float64Array ? [value] : Object.values(value);
    return ports.map((port) => Array.from(port));
  });
}
writeFileSync("found.json", JSON.stringify(found));
"""


def draw(port, rng, beta):
    # Of bodies that exist: for others the mass matrix can be near singular, and rounding grows.
    if port.name == "beta":
        return np.array(beta)
    if port.name in {"f", "h", "IA", "way"}:
        return rng.uniform(0.1, 2.0, port.shape)
    return rng.uniform(-2.0, 2.0, port.shape)


@needs_node
@pytest.mark.parametrize("name", ["panda", "two_link_elastic"])
def test_node_gives_what_c_gives(name, tmp_path):
    robot = symid.load(name)
    written = robot.write("js", tmp_path / "js")
    assert written.selftest == "passed"
    library, rng = robot.compile(), np.random.default_rng(5)
    _, beta, _ = build_values(robot.description, build_model(robot.description, "base"))
    given, expected = {}, {}
    for spec in library.card.functions:
        shared = {port.name: draw(port, rng, beta) for port in spec.inputs if port.shared}
        samples = [
            [shared.get(port.name, draw(port, rng, beta)) for port in spec.inputs] for _ in range(STATES)
        ]
        given[spec.name] = [[value.ravel().tolist() for value in sample] for sample in samples]
        function = getattr(library, spec.name)
        expected[spec.name] = [function(*sample) for sample in samples]
    (tmp_path / "js" / "given.json").write_text(json.dumps(given))
    (tmp_path / "js" / "run.mjs").write_text(RUN % f"symid_{name}")
    subprocess.run([NODE, "run.mjs"], cwd=tmp_path / "js", check=True, timeout=600)
    found = json.loads((tmp_path / "js" / "found.json").read_text())
    for spec in library.card.functions:
        for ours, theirs in zip(found[spec.name], expected[spec.name], strict=True):
            ports = theirs if isinstance(theirs, tuple) else (theirs,)
            for value, port in zip(ours, ports, strict=True):
                flat = np.asarray(port).ravel()
                assert np.abs(np.array(value) - flat).max() <= 1e-12 * max(1.0, np.abs(flat).max()), spec.name


def test_every_operation_is_printed():
    table = ExpressionTable()
    x, y = table.input(0, 0), table.input(0, 1)
    values = [table.apply(op, x) for op in (Op.EXP, Op.TANH, Op.ABS, Op.SIGN)]
    values += [table.apply(op, x, y) for op in (Op.POWER, Op.LESS, Op.LESS_EQUAL, Op.MAXIMUM, Op.MINIMUM)]
    spec = make_spec({"x": 2}, {"y": len(values)})
    text = "\n".join(print_javascript(table.build_program(spec, (tuple(values),))))
    for call in ("Math.tanh", "Math.pow", "Math.max", "_less(", "Math.sign"):
        assert call in text
    assert text.startswith("let t1")


def test_without_node_the_folder_says_that_nothing_was_tested(tmp_path, monkeypatch):
    from symid.codegen import generation

    monkeypatch.setattr(generation, "_find_node", lambda: "")
    written = symid.load("two_link").write("js", tmp_path / "js", functions=["gravity"])
    assert written.selftest == "not run"
    assert "install it, then `node selftest.mjs`" in str(written.notices[-1])
