"""Warnings say what was found, why it matters, and what to do: read from the texts where they are made."""

import ast
import re

from symid.errors import NOTES
from tests.architecture.source import MODULES, PROJECT

_CODE = re.compile(
    r"(?:check|codegen|compare|diagnosis|elastic|excitation|export|friction|generate|identify|log|new|"
    r"payload|robot|simulate|validate)\.[a-z][a-z-]+"
)
_VERBS = (
    "accelerate|add|begin|check|choose|compare|correct|cut|fit|give|identify|install|keep|lay|leave|let|load|"
    "log|look|lower|move|multiply|name|raise|record|remove|resample|run|save|see|set|shift|shorten|slow|"
    "state|take|try|turn|use|validate|write"
)
_REMEDY = re.compile(
    rf"(?:[.;:,]|\bso|\bor|\bothers) (?:{_VERBS})\b|`symid check|\bnot, name|; to compare so:", re.IGNORECASE
)
_MORE = re.compile(r"[:;.] |, (?:so|which|where|as|of which|but|because|and|or|beyond|more)\b|, ")
_RAISED = {
    *(
        "check.nothing",
        "check.poor",
        "codegen.cannot-load",
        "codegen.no-reference",
        "compare.gate",
        "diagnosis.changed-log",
    ),
    *(
        "diagnosis.no-file",
        "generate.selftest-failed",
        "identify.nothing",
        "identify.refused",
        "identify.standstill",
        "log.joints",
    ),
    *("log.no-column", "log.no-link-encoder", "log.short-alignment", "new.unwritable", "robot.bad-length"),
    *("robot.missing-key", "robot.syntax", "robot.xacro", "validate.friction-joint", "validate.gate-missed"),
}
"""Codes of errors that are collected before they are raised, or end a call that misses a gate."""
_FOREIGN = {"robot.xacro-warning"}
"""What another program printed."""
_PRICED = {"robot.angle-snapped", "robot.axis-snapped"}
"""Why they matter is a note of its own, `robot.rounding-price`, with the change of the torque."""
_ISSUERS = {"build_warning", "describe_scales", "_count", "parse_toml", "_get_source", "read_linear_form"}
"""What takes a code and has its text, or raises, elsewhere."""


_FUNCTIONS = {
    entry.name: entry
    for module in MODULES
    for entry in module.tree.body
    if isinstance(entry, ast.FunctionDef)
}


def _find_value(scope, name, line):
    """Return what was last put into `name` before a line, and what was added to it since."""
    found = []
    for entry in scope.body if isinstance(scope, ast.Module) else ast.walk(scope):
        pairs = []
        if isinstance(entry, ast.For | ast.comprehension):
            pairs = [(own, entry.iter) for own in ast.walk(entry.target)]
        elif isinstance(entry, ast.Assign | ast.AugAssign | ast.NamedExpr):
            for target in entry.targets if isinstance(entry, ast.Assign) else [entry.target]:
                both = isinstance(target, ast.Tuple) and isinstance(entry.value, ast.Tuple)
                pairs += zip(target.elts, entry.value.elts, strict=False) if both else [(target, entry.value)]
        found += [
            (own.lineno, isinstance(entry, ast.AugAssign), value)
            for own, value in pairs
            if getattr(own, "id", "") == name and own.lineno < line + isinstance(entry, ast.comprehension)
        ]
    found.sort(key=lambda place: place[0])
    starts = [place for place, (_, added, _) in enumerate(found) if not added]
    return [value for _, _, value in found[starts[-1] :]] if starts else []


def _write(node, scopes, depth=0):
    """Return the text of an expression in functions and module, and "..." for its values."""

    def write(*parts):
        return "".join(_write(part, scopes, depth) for part in parts)

    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts) | ast.Tuple(elts=parts) | ast.List(elts=parts):
            return write(*parts)
        case ast.FormattedValue(value=value) | ast.ListComp(elt=value) | ast.GeneratorExp(elt=value):
            return write(value)
        case ast.BinOp(left=left, right=right, op=ast.Add()):
            return write(left, right)
        case ast.IfExp(body=first, orelse=second):
            return max(write(first), write(second), key=len)
        case ast.Call(func=ast.Name(id=name)) if name in _FUNCTIONS and depth < 4:
            own = _FUNCTIONS[name]
            ends = [entry for entry in ast.walk(own) if isinstance(entry, ast.Return | ast.Yield)]
            return max((_write(end.value, (own,), depth + 1) for end in ends), key=len, default="...")
        case ast.Name(id=name, lineno=line) if depth < 4:
            found = next(filter(None, (_find_value(scope, name, line) for scope in scopes)), ())
            return "".join(_write(value, scopes, depth + 1) for value in found) or "..."
    return "..."


def _list_parts(node, holder):
    """Return the expressions of a notice's text, or nothing if `node` is not the code of one that is told."""
    match holder:
        case ast.Call(func=function, args=args, keywords=keywords):
            name = getattr(function, "attr", "") or getattr(function, "id", "")
            if name in _ISSUERS or name.startswith(("refuse", "build_file_error")):
                return []
            after = args[args.index(node) + 1 :] if node in args else []
            return [*after, *(entry.value for entry in keywords if entry.arg == "text")]
        case ast.Tuple(elts=[code, text]) if code is node and not isinstance(text, ast.Constant):
            return [text]
        case ast.Dict(keys=keys, values=values) if node in keys:
            return [values[keys.index(node)]]
    return []


def list_warnings():
    """Yield place, code and text of the notices that are neither notes nor raised where they stand."""
    for module in MODULES:
        lines = module.path.read_text(encoding="utf-8").splitlines()
        for part in module.tree.body:
            if not any(_CODE.search(line) for line in lines[part.lineno - 1 : part.end_lineno]):
                continue
            above = {child: node for node in ast.walk(part) for child in ast.iter_child_nodes(node)}
            for node in above:
                if isinstance(node, ast.Constant) and _CODE.fullmatch(str(node.value)):
                    around = [node]
                    while around[-1] in above:
                        around.append(above[around[-1]])
                    yield from _list_texts(module, node, around)


def _list_texts(module, node, around):
    if node.value in NOTES or any(isinstance(entry, ast.Raise) for entry in around):
        return
    parts = _list_parts(node, around[2 if isinstance(around[1], ast.keyword) else 1])
    if parts and not (isinstance(around[1], ast.Tuple) and isinstance(around[2], ast.Assign)):
        functions = tuple(entry for entry in around if isinstance(entry, ast.FunctionDef))
        text = "; ".join(_write(part, (*functions, module.tree)) for part in parts)
        yield f"{module.path.relative_to(PROJECT)}:{node.lineno}", node.value, text


def test_warnings_say_what_to_do_and_more_than_what_was_found():
    told = [entry for entry in list_warnings() if entry[1] not in _RAISED | _FOREIGN and entry[2] != "..."]
    assert len(told) > 100, "the texts are not found"
    assert not [entry for entry in told if not _REMEDY.search(entry[2])]
    bare = []
    for place, code, text in told:
        remedy = _REMEDY.search(text)
        rest = text[: remedy.start()] + text[remedy.end() :].partition(";")[2]
        if code not in _PRICED and not _MORE.search(rest):
            bare.append((place, code, text))
    assert not bare


def test_errors_that_are_exempt_exist():
    codes = {code for _, code, _ in list_warnings()}
    assert codes >= _RAISED | _FOREIGN | _PRICED
