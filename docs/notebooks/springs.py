# %% [markdown]
# # Springs that remember
#
# A harmonic drive is a spring, but not only: turn it and come back, and the torque is another one. Its
# torque depends on the way, not on the torsion alone. This notebook builds such a spring from the simplest
# part there is, a spring that slips, and finds in it all that is measured on real drives: loops, branches
# that follow Masing's rule, a memory that is wiped out, energy that is stored and energy that is lost, and
# an exact inverse.

# %%
from dataclasses import replace

import numpy as np

import symid
from symid.joint_models import (
    compute_hysteresis_torque,
    invert_hysteresis,
    run_element,
)
from symid.report.figures import Line, build_curve_figure, build_line_figure

# %% [markdown]
# ## A spring that slips
#
# A spring of stiffness $k$ behind dry friction. Its own torsion $E$ follows the torsion $\varphi$ until it
# reaches the threshold $r$; then it slips and keeps $|E| = r$. This is the **stop operator**:
# $E \leftarrow \operatorname{clip}(E + \Delta\varphi,\ -r,\ r)$.


# %%
def run_stop(phi, r):
    """Return the own torsion of a stop along torsions that start at zero."""
    state, states = 0.0, []
    for before, now in zip(np.r_[0.0, phi[:-1]], phi, strict=True):
        state = min(max(state + now - before, -r), r)
        states.append(state)
    return np.array(states)


def go(*turns, steps=200):
    """Return torsions from zero to each turning point in turn, rad."""
    ways = [np.linspace(a, b, steps, endpoint=False) for a, b in zip((0.0, *turns), turns, strict=False)]
    return np.concatenate([*ways, turns[-1:]])


def draw(caption, *lines):
    """Return torque over torsion, in mrad."""
    styles = ("first", "second", "third")
    drawn = [Line(name, style, 1e3 * x, y) for style, (name, x, y) in zip(styles, lines, strict=False)]
    return symid.Figures(drawings=(build_curve_figure(caption, ("torsion, mrad", "torque, N m"), drawn),))


phi = go(0.01, -0.01, 0.01)
one = 100.0 * run_stop(phi, 0.004)
draw("One stop: it sticks, slips, and sticks again", ("100 N m/rad, threshold 4 mrad", phi, one))

# %% [markdown]
# ## Several of them, and a spring beside
#
# With springs of different thresholds in parallel, one after another slips, and the corners become a curve:
#
# $$\tau_J = k_0 \varphi + \sum_i k_i E_{r_i}[\varphi].$$
#
# The shoulder of `two_link_elastic` has three. Its knees (the joint hardens beyond 3 N m) are left out
# first.

# %%
shoulder = symid.load("two_link_elastic").joints[0].elasticity
spring = replace(shoulder, knees=())
by_hand = spring.stiffness * phi + sum(s.stiffness * run_stop(phi, s.threshold) for s in spring.stops)
torque = compute_hysteresis_torque(spring, phi)
assert np.abs(torque - by_hand).max() < 1e-12
loop = torque - spring.stiffness * phi
draw("What the three stops add to the linear spring", ("stops", phi, loop))

# %% [markdown]
# ## Masing's rule
#
# Let $f$ be the curve of first loading. After a reversal at $(\varphi_r, \tau_r)$ every branch is the same
# curve, twice as large:
#
# $$\tau - \tau_r = 2 f\!\left(\tfrac12 (\varphi - \varphi_r)\right).$$
#
# No parameter is fitted for it: a stop that was at $+r$ must turn by $2r$ before it slips at $-r$.

# %%
first = go(0.01)
back = go(0.01, -0.01)[200:]
branch = compute_hysteresis_torque(spring, go(0.01, -0.01))[200:]
start = compute_hysteresis_torque(spring, first)[-1]
masing = start + 2 * np.array(
    [compute_hysteresis_torque(spring, np.array([0.0, (x - 0.01) / 2]))[-1] for x in back]
)
assert np.abs(branch - masing).max() < 1e-12

# %% [markdown]
# ## What it forgets
#
# Small inner loops leave no trace once the outer path goes on: the memory is wiped out. Two histories, one
# with a detour, end in the same torque.

# %%
plain, detour = go(0.008, -0.008, 0.008), go(0.008, -0.003, 0.002, -0.008, 0.004, 0.001, 0.008)
ends = [compute_hysteresis_torque(spring, way)[-1] for way in (plain, detour)]
assert abs(ends[0] - ends[1]) < 1e-12
draw(
    "Inner loops are wiped out",
    ("with detours", detour, compute_hysteresis_torque(spring, detour) - spring.stiffness * detour),
    ("straight", plain, compute_hysteresis_torque(spring, plain) - spring.stiffness * plain),
)

# %% [markdown]
# ## Energy: stored and lost
#
# Work on the torsion, $\int \tau_J\,d\varphi$, is either stored,
# $U = \tfrac12 k_0\varphi^2 + \tfrac12\sum k_i E_i^2$, or lost where stops slip,
# $D = \sum k_i r_i \int |\dot P_i|\,dt$ with $P_i = \varphi - E_i$. Lost energy never decreases: the spring
# is passive, whatever the path.


# %%
def lose(way):
    """Return D along torsions that start at zero, J."""
    plays = [(s, way - run_stop(way, s.threshold)) for s in spring.stops]
    return sum(s.stiffness * s.threshold * np.cumsum(np.abs(np.diff(p, prepend=0.0))) for s, p in plays)


way = go(0.01, -0.006, 0.009, -0.01, 0.01)
tau = compute_hysteresis_torque(spring, way)
stored, lost = run_element(spring, way).stored, lose(way)
work = np.concatenate([[0.0], np.cumsum(0.5 * (tau[1:] + tau[:-1]) * np.diff(way))])
assert np.abs(work - stored - lost).max() < 1e-5 * work.max()
assert np.all(np.diff(lost) >= 0)
length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way)))])
lines = [
    Line(name, style, 1e3 * length, 1e3 * y)
    for name, style, y in (("work", "first", work), ("stored", "second", stored), ("lost", "third", lost))
]
figure = build_line_figure("Where the work goes", ("way of the torsion, mrad", "energy, mJ"), lines)
symid.Figures(drawings=(figure,))

# %% [markdown]
# Over a closed cycle $\pm A$ the loss has a closed form, $4\sum k_i r_i \max(A - r_i, 0)$. With the numbers
# of the file and $A = 10$ mrad: $4\,(120 \cdot 0.002 \cdot 0.008 + 60 \cdot 0.005 \cdot 0.005 + 0) = 13.68$
# mJ.

# %%
cycle = go(0.01, -0.01, 0.01)
per_cycle = lose(cycle)
assert abs(per_cycle[-1] - per_cycle[200] - 0.01368) < 1e-12
print(f"{1e3 * (per_cycle[-1] - per_cycle[200]):.2f} mJ in each cycle, at any speed")

# %% [markdown]
# "At any speed" is how this differs from damping: a viscous loss grows with the frequency, this one does
# not. A plot of loss over frequency tells them apart.
#
# ## The inverse
#
# A controller wants a torque and needs the torsion. The inverse of such a spring is again made of play
# operators, with other thresholds and weights, exact (Kuhnen 2003): a feed-forward without iteration, knees
# included.

# %%
wanted = compute_hysteresis_torque(shoulder, way)
assert np.abs(invert_hysteresis(shoulder, wanted) - way).max() < 1e-15
draw(
    "With knees the joint hardens; the inverse comes back to the torsion",
    ("with knees", way, wanted),
    ("without", way, tau),
)

# %% [markdown]
# **To do**: (1) How large is the loss if the amplitude stays below 2 mrad, and why? (2) Replace the three
# stops by one with the same loss at 10 mrad; at which amplitudes do they differ most? (3) In the lesson
# (`symid derive two_link_elastic --html elastic.html`), drag the torsion until two stops slip and one
# sticks. (4) Prove the closed form of the loss from $D$.
