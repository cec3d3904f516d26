# %% [markdown]
# # Why only 43 of the 70 parameters of a Panda
#
# A rigid link has ten inertial parameters: six of its inertia tensor, three first moments, a mass. Seven
# links have 70. Anyone who identifies a Panda finds 43. Where are the other 27? Not lost in noise: no
# experiment with joint torques contains them. This notebook finds the number three times: by rank, by exact
# algebra, and by a reason for each.

# %%
from collections import Counter
from fractions import Fraction

import numpy as np

import symid
from symid.notation import INERTIAL
from symid.report.figures import Line, build_line_figure

robot = symid.load("panda")
robot

# %% [markdown]
# ## By rank
#
# Torques are linear in the 70 standard parameters: $\tau = Y(q, \dot q, \ddot q)\,\pi$. Sample $Y$ at
# random states, stack, and look at the singular values.

# %%
regressor = robot.casadi("torque_regressor", standard=True)
rng = np.random.default_rng(1)
samples = 60
states = [rng.normal(size=(7, samples)) for _ in range(3)]
stacked = np.array(regressor.map(samples)(*states))
# Side by side, one block a sample: put them below one another.
Y = np.vstack(np.split(stacked, samples, axis=1))
singular = np.linalg.svd(Y, compute_uv=False)
rank = int(np.sum(singular > 1e-10 * singular[0]))
assert Y.shape == (420, 70)
assert rank == 43
figure = build_line_figure(
    "Singular values of 420 equations for 70 parameters",
    ("number", "singular value"),
    [Line("singular values", "first", np.arange(1.0, 71.0), np.maximum(singular, 1e-17), markers=True)],
    logarithmic=True,
    whole=True,
)
symid.Figures(drawings=(figure,))

# %% [markdown]
# A cliff of more than ten decades behind the 43rd: this is structure, not noise. But a rank says *how
# many*, not *which* or *why*.

# %%
print(f"the 43rd is {singular[42]:.2g}, the 44th {singular[43]:.1e}")
assert singular[42] / singular[43] > 1e10

# %% [markdown]
# ## By exact algebra
#
# symid compares the energies per unit of each parameter as functions of the joint angles, with exact
# numbers. What depends on others is grouped with them, in the order of Khalil.

# %%
base = robot.base
assert base.count == rank
assert len(base.product.eliminated) == 70 - base.count
base

# %% [markdown]
# The exact null space: 27 changes of parameters, each with exact coefficients, that no torque shows. Take
# the one that makes link 4 a kilogram heavier; others give what it takes.

# %%
changes = base.to_dict()["null_space"]
assert len(changes) == 27
(heavier,) = [change for change in changes if change.get("M4") == "1"]
heavier

# %% [markdown]
# Read it: 79/250 is the offset of 0.316 m from joint 3 to joint 2, 33/400 the 0.0825 m of the elbow. What
# looks like one kilogram at link 4 is also a change of first moments and inertias of links 2 and 3. Applied
# to the sampled equations, it and the other 26 vanish.

# %%
labels = [f"{name}{link}" for link in range(1, 8) for name in INERTIAL]
null = np.array([[float(Fraction(change.get(label, "0"))) for label in labels] for change in changes])
assert np.linalg.matrix_rank(null) == 27
assert np.abs(Y @ null.T).max() < 1e-12
largest = np.abs(Y @ null.T).max(), np.abs(Y).max()
print(f"largest torque of any of the 27: {largest[0]:.1e} N m, of a parameter alone: {largest[1]:.0f} N m")

# %% [markdown]
# ## By reasons
#
# Each of the 27 has a reason that can be drawn on a blackboard.

# %%
reasons = Counter()
for entry in base.product.eliminated:
    name = entry.name.rstrip("0123456789")
    where = "link 1" if entry.name.endswith("1") else "each later link"
    reasons[where, name if where != "link 1" else "all but ZZ"] += 1
assert reasons["link 1", "all but ZZ"] == 9
assert all(reasons["each later link", name] == 6 for name in ("YY", "MZ", "M"))
assert base.count == 70 - 9 - 3 * 6
for name in ("YY7", "MZ7", "M7", "XY1"):
    print(base.explain(name))

# %% [markdown]
# - **Link 1** turns about one fixed vertical axis: of ten numbers only $ZZ_1$ does anything. Nine are gone.
# - **Each later link** loses three. $M_j$: a mass on the axis of joint $j$ stays where it is as joint $j$
#   turns, so the link before carries it. $MZ_j$: the same mass shifted along the axis still stays where it
#   is. $YY_j$: turning link $j$ mixes $XX_j$ and $YY_j$; their sum is constant and belongs to the link
#   before, only $XX_j - YY_j$ turns with the link.
#
# $70 - 9 - 6 \cdot 3 = 43$, without a computer. The lesson of the Panda (`symid derive panda --html
# panda.html`) plays these motions: "show" beside each group.
#
# ## What other measurements show
#
# Would another sensor see more? The energies contain the same 43. Momentum has no gravity in it, and loses
# what only gravity shows; an arm at rest shows first moments only.

# %%
counts = {form: robot.derive_base(form).count for form in ("torque", "energy", "momentum", "gravity")}
assert counts == {"torque": 43, "energy": 43, "momentum": 39, "gravity": 12}
counts

# %% [markdown]
# **To do**: (1) The base is tilted. Which two parameters come back, and why? Predict, then check with
# `gravity = [1, 0, -9.81]` in a copy of the robot file (45 base parameters). (2) Count the base parameters
# of a SCARA on the blackboard: one of its joints slides, and all axes are parallel. (`symid base scara`.)
# (3) A payload of 1 kg is bolted to link 7: which of the 43 change?
