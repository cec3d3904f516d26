"""Colours of pages: contrast on their ground (WCAG 2.1), and distances as colour-blind readers see them.

Dichromats by the matrices of Machado, Oliveira and Fernandes (2009), table 1, severity 1, which act on linear
RGB; distances in CIELAB (CIE 1976), where about 2.3 is just noticeable.
"""

import re
from itertools import combinations

import numpy as np
import pytest

from symid.environment import locate_resource_folder
from symid.report.blocks import _COLOURS as NOTEBOOK

VISIONS = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
TOGETHER = {"blue": ("orange", "teal", "soft", "wrong", "good"), "orange": ("teal", "soft")}
TOGETHER |= {"wrong": ("good",)}
"""Colours of curves that stand in one figure without a difference in their dashes; axes of a frame."""
CURVES = ("blue", "orange", "teal", "soft", "wrong", "good", "ink")
"""Those of the seven styles of curves, which dashes tell apart as well."""


def read_palettes():
    css = (locate_resource_folder("templates") / "report" / "page.css").read_text()
    found, colours = {}, {}
    for name, block in zip(("light", "dark", "print"), re.findall(r":root \{([^}]*)\}", css), strict=True):
        colours = colours | dict(re.findall(r"--(\w+): (#[0-9a-f]{3,6})", block))
        found[name] = dict(colours)
    return found


PALETTES = read_palettes()


def linearise(colour):
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    values = np.array([int(digits[k : k + 2], 16) for k in (0, 2, 4)]) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def compute_contrast(first, second):
    light, dark = sorted((float(TO_XYZ[1] @ linearise(colour)) for colour in (first, second)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def compute_lab(colour, vision):
    white = TO_XYZ @ np.ones(3)
    ratio = TO_XYZ @ np.clip(VISIONS[vision] @ linearise(colour), 0.0, 1.0) / white
    x, y, z = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def compute_distance(first, second, vision):
    return float(np.linalg.norm(compute_lab(first, vision) - compute_lab(second, vision)))


def test_what_is_computed_agrees_with_known_values():
    assert compute_contrast("#000", "#fff") == pytest.approx(21.0)
    # The grey that the guidelines name as the lightest of sufficient contrast on white.
    assert compute_contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.01)
    assert compute_lab("#ffffff", "normal") == pytest.approx([100.0, 0.0, 0.0], abs=1e-2)
    assert compute_lab("#ff0000", "normal") == pytest.approx([53.24, 80.09, 67.20], abs=0.05)
    # Dichromats lose red beside a dark green.
    far, near = (compute_distance("#a05000", "#508000", vision) for vision in ("normal", "deuteranopia"))
    assert near < 0.5 * far


@pytest.mark.parametrize("name", PALETTES)
def test_texts_and_lines_have_contrast(name):
    colours = PALETTES[name]
    for text in ("ink", "soft", "good", "usable", "doubtful", "wrong", "blue"):
        for ground in ("ground", "panel"):
            assert compute_contrast(colours[text], colours[ground]) >= 4.5, (text, ground)
    for line in ("blue", "orange", "teal", "soft", "good", "wrong"):
        assert compute_contrast(colours[line], colours["ground"]) >= 3.0, line


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("name", PALETTES)
def test_curves_of_a_figure_can_be_told_apart(name, vision):
    colours = PALETTES[name]
    for first, second in ((first, second) for first, others in TOGETHER.items() for second in others):
        assert compute_distance(colours[first], colours[second], vision) >= 15.0, (first, second)
    for first, second in combinations(CURVES, 2):
        assert compute_distance(colours[first], colours[second], vision) >= 5.0, (first, second)


def test_notebooks_have_colours_that_hold_on_both_grounds():
    for name, colour in NOTEBOOK.items():
        if re.fullmatch("#[0-9a-f]{6}", colour):
            assert compute_contrast(colour, "#ffffff") >= 3.0, name
            assert compute_contrast(colour, "#161b22") >= 3.0, name
