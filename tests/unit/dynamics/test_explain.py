"""Base parameters in words."""

import pytest
from sympy import Rational, Symbol, sqrt

from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.explanations import write_combination, write_number
from tests.chains import PANDA, PI, TWO_LINK, build_chain


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Rational(1), "1"),
        (Rational(-3), "-3"),
        (Rational(2159, 5000), "0.4318"),
        (Rational(-1, 8), "-0.125"),
        (Rational(1, 3), "1/3"),
        (Symbol("L1") ** 2, "L1^2"),
        (Symbol("L1") + Symbol("L2"), "(L1 + L2)"),
        (sqrt(3) / 2, "sqrt(3)/2"),
        (Rational(10**25 + 1, 3 * 10**25), "~0.333333333333333"),
    ],
)
def test_numbers(value, text):
    assert write_number(value) == text


def test_combinations():
    terms = [("XX2", Rational(1)), ("YY2", Rational(-1)), ("M3", Rational(-1, 4)), ("MZ3", Rational(1, 2))]
    assert write_combination(terms) == "XX2 - YY2 - 0.25*M3 + 0.5*MZ3"
    assert write_combination([("M1", Rational(-2))]) == "-2*M1"


def test_every_parameter_has_a_reason():
    base = derive_base_parameters(PANDA)
    accounted = {p.label for p in base.parameters} | {e.label for e in base.eliminated}
    assert accounted == set(base.labels)
    reasons = {e.name: e.reason for e in base.eliminated}
    assert reasons["M7"].startswith("grouped into XXR2, ZZR2, MYR2")
    assert "moves with link 6" in reasons["M7"]
    assert reasons["XX1"] == "no effect on joint torques: link 1 turns about its z axis only"
    assert "XX4 - YY4" in reasons["YY4"]


def test_reasons_name_the_group():
    base = derive_base_parameters(TWO_LINK)
    first = base.parameters[0]
    assert (first.name, first.expression) == ("ZZR1", "ZZ1 + 0.25*M2")
    assert " with M2: mass " in first.reason
    assert "joint 2" in first.reason
    assert first.reason.endswith("link 1")


def test_slides_do_not_turn():
    base = derive_base_parameters(build_chain([(0.0, 0, "q", 0.0), (PI / 2, 0, "q", 0.0), (0.0, 0, 0, "q")]))
    reasons = {e.name: e.reason for e in base.eliminated}
    assert "link 1 never turns" in reasons["ZZ1"]
