"""The folders that come with symid are found in a checkout and in a wheel."""

import pytest

import symid.environment
from symid.environment import locate_resource_folder
from symid.errors import SymidError


def test_in_a_checkout_they_stand_beside_the_package(project):
    assert locate_resource_folder("robots") == project / "robots"
    assert locate_resource_folder("templates") == project / "templates"


def test_in_a_wheel_they_stand_inside_the_package_and_win(monkeypatch, tmp_path):
    (tmp_path / "robots").mkdir()
    inside = tmp_path / "symid" / "_data" / "robots"
    inside.mkdir(parents=True)
    monkeypatch.setattr(symid.environment, "_PACKAGE", tmp_path / "symid")
    assert locate_resource_folder("robots") == inside


def test_a_broken_installation_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(symid.environment, "_PACKAGE", tmp_path / "symid")
    with pytest.raises(SymidError, match="install") as caught:
        locate_resource_folder("robots")
    assert caught.value.notices[0].code == "symid.missing-resource"
