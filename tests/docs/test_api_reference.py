"""The reference of the Python API: every public name is described, with an example that runs."""

import dataclasses
import doctest
import inspect
import operator
import re

import pytest

import symid
from tests.simulations import share_simulations


def list_names():
    """Return all public names; those of a module that is offered stand behind its own."""
    for name in symid.__all__:
        if inspect.ismodule(getattr(symid, name)):
            module = getattr(symid, name)
            inside = ((key, getattr(module, key)) for key in dir(module))
            # A file of the API, or a room of its own.
            own = (f"symid.api.{name}", f"symid.{name}.")
            yield from (
                f"{name}.{k}" for k, value in inside if getattr(value, "__module__", "").startswith(own)
            )
        elif name != "__version__":
            yield name


def find(name):
    """Return what a public name stands for."""
    return operator.attrgetter(name)(symid)


NAMES = list(list_names())
CLASSES = [name for name in NAMES if inspect.isclass(find(name))]
ERRORS = [name for name in CLASSES if issubclass(find(name), Exception)]


def list_members(name):
    """Return the public functions and properties that a class brings, with their names."""
    owner = find(name)
    found = {
        f"{name}.{key}": value.fget if isinstance(value, property) else getattr(value, "func", value)
        for kind in reversed(owner.__mro__)
        if kind.__module__.startswith("symid.")
        for key, value in vars(kind).items()
        if not key.startswith("_") and key not in vars(kind).get("__dataclass_fields__", ())
    }
    return {key: value for key, value in found.items() if inspect.isfunction(value)}


PLAIN = {name: find(name) for name in NAMES if name not in CLASSES}
MEMBERS = {key: value for name in CLASSES for key, value in list_members(name).items()}
FUNCTIONS = PLAIN | MEMBERS


def list_untold(names, text):
    """Return the names that a docstring says nothing of."""
    return [name for name in names if not re.search(rf"^ +{name}: |`{name}`", text, re.MULTILINE)]


def begins_with_one_line(name):
    text = inspect.getdoc(FUNCTIONS.get(name) or find(name)) or ""
    first, *rest = text.splitlines() or [""]
    return first.endswith(".") and rest[:1] in ([], [""])


def test_one_line_says_what_each_name_is():
    assert [name for name in [*CLASSES, *FUNCTIONS] if not begins_with_one_line(name)] == []


def test_every_argument_is_described():
    for function in FUNCTIONS.values():
        names = [name for name in inspect.signature(function).parameters if name not in {"self", "cls"}]
        assert list_untold(names, inspect.getdoc(function) or "") == []


def test_every_field_is_described():
    for owner in filter(dataclasses.is_dataclass, (find(name) for name in CLASSES if name not in ERRORS)):
        text = "".join(inspect.getdoc(kind) or "" for kind in owner.__mro__ if kind is not object)
        fields = [field.name for field in dataclasses.fields(owner) if not field.name.startswith("_")]
        assert list_untold(fields, text) == [], owner


def test_every_name_has_an_example():
    # Errors are caught alike.
    owners = {name: symid.SymidError if name in ERRORS else find(name) for name in NAMES}
    parser = doctest.DocTestParser()
    assert [name for name, owner in owners.items() if not parser.get_examples(inspect.getdoc(owner))] == []


WITH_EXAMPLES = [name for name in [*CLASSES, *FUNCTIONS] if name not in ERRORS or name == "SymidError"]
EXAMPLES = {}
for each in WITH_EXAMPLES:
    # Inherited methods have the examples of their class.
    said = inspect.getdoc(FUNCTIONS.get(each) or find(each)) or ""
    if ">>>" in said and said not in EXAMPLES.values():
        EXAMPLES[each] = said


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.usefixtures("c_compiler")
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    share_simulations(monkeypatch)
    example = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, None, 0)
    said = []
    doctest.DocTestRunner(optionflags=doctest.IGNORE_EXCEPTION_DETAIL).run(example, out=said.append)
    assert not said, "".join(said)


def test_the_page_lists_every_name(project):
    page = (project / "docs" / "api" / "reference.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto(?:class|function|exception):: symid\.([\w.]+)$", page, re.MULTILINE)
    assert sorted(listed) == sorted(NAMES)
