"""The folders that come with symid are found in a checkout and in a wheel."""

import symid.environment
from symid.environment import locate_resource_folder
from symid.errors import SymidError
from tests.refusals import raises


def test_resources_stand_beside_the_package_or_inside_it(project, monkeypatch, tmp_path):
    assert locate_resource_folder("robots") == project / "robots"
    assert locate_resource_folder("templates") == project / "templates"
    monkeypatch.setattr(symid.environment, "_PACKAGE", tmp_path / "symid")
    with raises(SymidError, "symid.missing-resource", match="install"):
        locate_resource_folder("robots")
    (tmp_path / "robots").mkdir()
    inside = tmp_path / "symid" / "_data" / "robots"
    inside.mkdir(parents=True)
    monkeypatch.setattr(symid.environment, "_PACKAGE", tmp_path / "symid")
    assert locate_resource_folder("robots") == inside
