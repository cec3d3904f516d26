# %% [markdown]
# # The two-link arm, by hand and by symid
#
# Every course on robot dynamics derives this arm on the blackboard: two links in a vertical plane, length
# $L_1$, centres of mass at $l_{c1}$ and $l_{c2}$, masses $m_1, m_2$, central inertias $I_1, I_2$. Here it
# is done twice. First by hand, with Lagrange's equations in SymPy; then symid derives the same arm from its
# robot file. Both must agree symbol by symbol, and at the end a question: which of these masses can a motor
# feel at all?

# %%
import numpy as np
import sympy as sp

import symid
from symid.report.figures import Line, build_line_figure

# %% [markdown]
# ## By hand
#
# Angles $q_1$ from the horizontal, $q_2$ relative to the first link, as functions of time.

# %%
t = sp.Symbol("t")
m1, m2, L1, lc1, lc2, I1, I2, g = sp.symbols("m1 m2 L1 lc1 lc2 I1 I2 g", positive=True)
q1, q2 = sp.Function("q1")(t), sp.Function("q2")(t)

centre_1 = lc1 * sp.Matrix([sp.cos(q1), sp.sin(q1)])
elbow = L1 * sp.Matrix([sp.cos(q1), sp.sin(q1)])
centre_2 = elbow + lc2 * sp.Matrix([sp.cos(q1 + q2), sp.sin(q1 + q2)])

# %% [markdown]
# Kinetic energy: each centre of mass moves, each link turns. The second link turns at
# $\dot q_1 + \dot q_2$: to forget $\dot q_1$ there is the most frequent mistake in this derivation.
# The square of the second velocity is a law of cosines:

# %%
v1, v2 = centre_1.diff(t), centre_2.diff(t)
squared = sp.simplify(v2.dot(v2))
T = (m1 * v1.dot(v1) + m2 * squared + I1 * q1.diff(t) ** 2 + I2 * (q1 + q2).diff(t) ** 2) / 2
V = g * (m1 * centre_1[1] + m2 * centre_2[1])
squared

# %% [markdown]
# Lagrange:
#
# $$\tau_i = \frac{d}{dt}\frac{\partial T}{\partial \dot q_i} - \frac{\partial T}{\partial q_i} +
# \frac{\partial V}{\partial q_i}$$

# %%
angles = sp.Matrix([q1, q2])
torques = sp.Matrix([(T.diff(q.diff(t))).diff(t) - T.diff(q) + V.diff(q) for q in angles]).applyfunc(
    sp.expand
)
by_hand = torques.jacobian(angles.diff(t, 2)).applyfunc(sp.simplify)
by_hand

# %% [markdown]
# ## By symid
#
# The robot file states the same symbols. `robot.sympy` gives each function of the catalogue as exact
# expressions, in the base parameters; what these stand for is stated too.

# %%
robot = symid.load("two_link_symbols")
robot.base

# %%
M = robot.sympy("mass_matrix")
M

# %% [markdown]
# Put the symbols of the file in, and compare with the blackboard. `simplify` is not trusted: sines and
# cosines become exponentials, and an expanded sum of exponentials is zero only if nothing is left.

# %%
forms = {entry["name"]: entry["form"] for entry in robot.base.to_dict()["parameters"]}
letters = {str(symbol): symbol for symbol in (m1, m2, L1, lc1, lc2, I1, I2, g)}
parameters = {
    # A parameter without a formula is one that the file states as zero: MY1, MY2.
    symbol: sp.sympify(forms[symbol.name], locals=letters) if forms[symbol.name] else sp.Integer(0)
    for symbol in M.inputs["beta"]
}
plain = {
    **{q.diff(t, 2): sp.Symbol(f"ddq{k}") for k, q in enumerate(angles, start=1)},
    **{q.diff(t): sp.Symbol(f"dq{k}") for k, q in enumerate(angles, start=1)},
    **{q: sp.Symbol(f"q{k}") for k, q in enumerate(angles, start=1)},
}


def is_zero(matrix):
    """Return whether all elements vanish, as sums of complex exponentials."""
    return all(sp.expand(sp.sympify(value).rewrite(sp.exp)) == 0 for value in sp.flatten(matrix))


def put_in(matrix):
    """Return an output of symid in the symbols of the file."""
    return matrix.subs(parameters).subs({sp.Symbol(name): symbol for name, symbol in letters.items()})


assert is_zero(put_in(M["M"]) - by_hand.subs(plain))

tau = robot.sympy("inverse_dynamics")
assert is_zero(put_in(tau["tau"]) - torques.subs(plain))
put_in(M["M"]).applyfunc(sp.expand)

# %% [markdown]
# The whole equation of motion agrees, not only $M$. What else must hold? Work: $\dot M - 2C$ is skew, so
# that $C \dot q$ does none.

# %%
C = robot.sympy("coriolis_matrix")
Q, dQ = C.inputs["q"], C.inputs["dq"]
rate = M["M"].diff(Q[0]) * dQ[0] + M["M"].diff(Q[1]) * dQ[1]
skew = rate - 2 * C["C"]
assert is_zero(skew + skew.T)
skew.applyfunc(sp.simplify)

# %% [markdown]
# ## What the elbow does to the shoulder
#
# $M_{11}$ is the inertia that the shoulder's motor accelerates. It depends on the elbow alone: largest for
# the stretched arm, smallest for the folded one.

# %%
lib = robot.compile()
bend = np.linspace(-np.pi, np.pi, 181)
inertia = np.array([lib.mass_matrix([0.0, angle], lib.beta)[0, 0] for angle in bend])
values = {m1: 3, m2: 2, L1: sp.Rational(1, 2), lc1: sp.Rational(1, 4), lc2: sp.Rational(1, 5)}
values |= {I1: sp.Rational(7, 100), I2: sp.Rational(3, 100)}
stretched = put_in(M["M"])[0, 0].subs(values).subs(sp.Symbol("q2"), 0)
assert stretched == sp.Rational(507, 400)
assert abs(inertia[90] - 507 / 400) < 1e-15
figure = build_line_figure(
    "The inertia at the shoulder over the angle of the elbow",
    ("elbow, rad", "M11, kg m²"),
    [Line("M11", "first", bend, inertia)],
)
symid.Figures(drawings=(figure,))

# %% [markdown]
# ## Which masses does a motor feel?
#
# With $L_1$ known, six numbers describe the two links: $m_1, l_{c1}, I_1, m_2, l_{c2}, I_2$. The torques
# contain only four combinations of them, the base parameters that are not zero:
# $ZZ_1^R, MX_1^R, ZZ_2, MX_2$. So there are different arms that no experiment with torques tells apart.
# Here is one: the first link twice as heavy, its centre of mass at half the distance, its inertia a little
# larger.

# %%
other = {m1: 2 * m1, lc1: lc1 / 2, I1: I1 + m1 * lc1**2 / 2}
changed = torques.subs(other, simultaneous=True)
assert is_zero((changed - torques).subs(plain))
{str(old): new for old, new in other.items()}

# %% [markdown]
# The torques are the same polynomials. This is why identification estimates base parameters, and why "the
# mass of link 1" is not a measurement.
#
# **To do**: (1) a payload $m_p$ at the tip of the second link, at $L_2$: which base parameters change, by
# what? (2) Let gravity be zero: which of the four are left? (`robot.derive_base("gravity")` lists those
# that torques at rest show.) (3) Find another arm with the same torques in which $m_2$ is changed.
