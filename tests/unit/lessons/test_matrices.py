"""The matrices of lessons: exact identities, the trees of textbooks read back, names put in again."""

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sympy import sympify

import symid
from symid.lessons import matrices, textbook
from symid.robot import load_robot
from tests.chains import PI, build_chain

SHORT = ("two_link", "two_link_symbols", "two_link_elastic", "ppr", "rrp_twisted", "double_pendulum")
LONG = ("scara", "panda", "quadruped", "stanford")


@pytest.fixture(scope="module", params=SHORT)
def equations(request):
    return matrices.derive_equations(matrices.build_model(load_robot(request.param)))


def test_identities_hold_and_what_is_written_is_what_was_derived(equations):
    for name in ("mass_is_curvature", "skew", "newton_euler", "power"):
        assert getattr(matrices, f"check_{name}")(equations)
    model, energies = equations.model, (equations.kinetic, equations.potential)
    values = [*equations.gravity, *equations.christoffel.values(), *chain.from_iterable(equations.mass)]
    for value in (*values, *energies):
        assert textbook.expand_sum(textbook.write_sum(value, model.sums), model.algebra) == value


@pytest.mark.parametrize("name", LONG)
def test_names_put_in_give_the_matrices(name):
    composites = matrices.derive_composites(load_robot(name))
    assert matrices.check_composites(composites)
    # Short enough to read: no element and no definition has more than twenty products.
    values = [*composites.mass.values(), *composites.gravity, *(e.value for e in composites.definitions)]
    assert max(textbook.write_sum(x, composites.model.sums).count_terms() for x in values) <= 20


def test_every_element_of_the_puma_is_the_exact_polynomial():
    """All names put in, the elements of M and g are the polynomials of the base form, term by term."""
    robot = load_robot("puma560")
    composites, found = (
        matrices.derive_composites(robot),
        matrices.derive_equations(matrices.build_model(robot, "base")),
    )
    ring = found.model.algebra
    values = {name: ring.generators.get(name) for name in map(str, composites.model.algebra.ring.symbols)}

    def put(polynomial):
        total = ring.zero
        for exponents, coefficient in polynomial.terms():
            term = ring.one * coefficient
            for symbol, power in zip(polynomial.ring.symbols, exponents, strict=True):
                for _ in range(power):
                    term = ring.mul(term, values[str(symbol)])
            total += term
        return total

    for entry in composites.definitions:
        values[entry.name] = put(entry.value)
    assert all(put(value) == found.mass[i][j] for (i, j), value in composites.mass.items())
    assert [put(value) for value in composites.gravity] == list(found.gravity)


def test_textbook_forms_chains_and_named_lengths():
    arm = build_chain(
        [(0.0, 0, 0, "q"), (0.0, "L1", 0, "q"), (0.0, "L2", 0, "q")], gravity=("0", "-9.81", "0")
    )
    found = matrices.derive_equations(matrices.build_model(arm))
    sums = [textbook.write_sum(value, found.model.sums) for value in (found.mass[1][2], found.gravity[2])]
    texts = [textbook.write_text(one, matrices.PLAIN_BOOK) for one in sums]
    assert texts == ["ZZ3 + L2*(MX3*c3 - MY3*s3)", "g*(MX3*c123 - MY3*s123)"]
    latex = textbook.write_latex(sums[1], textbook.build_style(textbook.get_book("khalil")))
    assert latex == r"g \, (\mathit{MX}_{3} \, C_{123} - \mathit{MY}_{3} \, S_{123})"
    arm = build_chain(
        [(0.0, 0, 0, "q"), (PI, 0.3, 0, "q"), (PI / 2, 0, 0, "q"), (0.0, 0.2, "q", 0.0), (0.0, 0.1, 0, "q")]
    )
    assert textbook.list_chains(arm) == (((1, 1), (2, -1)), ((3, 1), (5, 1)))
    named, lengths = matrices.name_lengths(load_robot("panda"), matrices.PLAIN_BOOK)
    assert (lengths["a4"], lengths["a5"]) == (0.0825, -0.0825)
    assert dict(named.symbols)["g"] == 9.81
    # The notice is usage.notation.
    with pytest.raises(symid.UsageError, match="one of symid, siciliano, craig, khalil"):
        textbook.get_book("spong")


@settings(deadline=None, max_examples=15)
@given(
    st.lists(st.tuples(st.integers(-4, 4), *[st.integers(0, 2)] * 6), min_size=1, max_size=6),
    st.integers(0, 2**16),
)
def test_any_polynomial_is_written_without_loss(terms, seed):
    arm = build_chain([(0.0, 0, 0, "q"), (PI, 0.5, 0, "q"), (0.0, 0.4, 0, "q")])
    model = matrices.build_model(arm, "base")
    known, algebra, value = model.algebra.generators, model.algebra, model.algebra.zero
    for number, *powers in terms:
        term = algebra.one * number
        for name, power in zip(("s1", "c1", "s2", "c2", "s3", "c3"), powers, strict=True):
            for _ in range(power):
                term = algebra.mul(term, known[name])
        value += term
    total = textbook.write_sum(value, textbook.build_angle_sums(arm))
    assert textbook.expand_sum(total, algebra) == value
    q = np.random.default_rng(seed).uniform(-3, 3, 3)
    point = {f"q{k}": float(x) for k, x in enumerate(q, 1)}
    written = sympify(textbook.write_code(total)).evalf(30, subs=point)
    waves = np.column_stack([np.sin(q), np.cos(q)]).ravel()
    direct = sum(float(n * np.prod(waves**powers)) for n, *powers in terms)
    assert float(written) == pytest.approx(direct, abs=1e-11)
