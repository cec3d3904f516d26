"""The gallery: its lines run, and draw what its pictures show."""

import re

import pytest

TITLE = re.compile(r"<title>(.*?)</title>")


def list_examples(project):
    page = (project / "docs" / "gallery.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    return blocks, re.findall(r"\{image\} gallery/(\w+\.svg)", page)


def test_every_picture_is_drawn_by_the_lines_above_it(project, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks, pictures = list_examples(project)
    assert len(blocks) == len(pictures) == len(set(pictures)) >= 5
    for block, picture in zip(blocks, pictures, strict=True):
        exec(compile(block, "gallery.md", "exec"), {})  # noqa: S102  the page's own example
        drawn, shown = ((folder / picture).read_text() for folder in (tmp_path, project / "docs" / "gallery"))
        assert TITLE.findall(drawn) == TITLE.findall(shown)
        assert len(drawn) == pytest.approx(len(shown), rel=0.02)
