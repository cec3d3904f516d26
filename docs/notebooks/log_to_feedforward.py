# %% [markdown]
# # From a log to feed-forward
#
# A controller that knows the arm gives most of the torque in advance,
# $\tau = M(q_d)\ddot q_d + C\dot q_d + g(q_d) + \tau_f(\dot q_d)$, and leaves to feedback only what the
# model does not know. The numbers in the model come from a log. This notebook goes the whole way: move,
# record, check, identify, test on another motion, and use the result. The robot is simulated, so that the
# truth is known and can be compared; nothing else uses it.

# %%
import numpy as np

import symid
from symid.report.figures import Line, build_line_figure

robot = symid.load("two_link")
robot

# %% [markdown]
# ## Move and record
#
# A random Fourier series under PD control, torque sensors with 0.05 N m of noise, encoders with steps. With
# a robot of your own `symid.read_log("log.csv", robot)` stands here.

# %%
train = robot.simulate(duration=8.0, seed=1).log
test = robot.simulate("tc", duration=8.0, seed=2).log
train

# %% [markdown]
# ## Check before fitting
#
# What does this log show, and what does it not? A parameter that the motion does not excite is found here,
# not after a week in the controller.

# %%
robot.check(train)

# %% [markdown]
# ## Identify
#
# Torques are linear in the base parameters and in Coulomb and viscous friction, so this is least squares,
# weighted by the noise of each joint; band and decimation are chosen from the log.

# %%
fit = robot.identify(train, estimator="wls")
fit

# %% [markdown]
# Do not look at the values first. Look at the deviations: is each parameter larger than two of its own? And
# because this log is simulated: is the truth where the deviations say?

# %%
truth = robot.base.values
errors = {name: (fit[name].value - truth[name]) / fit[name].std for name in fit}
assert max(map(abs, errors.values())) < 4
{name: round(error, 2) for name, error in errors.items()}

# %% [markdown]
# ## Test on another motion
#
# Nothing is fitted here. A model that only remembers its log fails on this one.

# %%
validation = fit.validate(test, gate=5.0)
assert validation.accepted
validation

# %% [markdown]
# ## Feed-forward
#
# Now the torques for the test motion in advance. A controller takes the planned motion; here the measured
# positions stand for it. Generated C computes all samples at once. What remains is feedback's part.

# %%
lib = robot.compile()
step = test.period
q = test.q
dq = np.gradient(q, step, axis=0)
# Encoder steps spoil differences: smooth over 40 ms. A planned trajectory has no such steps.
window = np.hanning(41) / np.hanning(41).sum()
smooth = np.column_stack([np.convolve(column, window, mode="same") for column in dq.T])
ddq = np.gradient(smooth, step, axis=0)
inner = slice(60, -60)
forward = lib.inverse_dynamics(q, smooth, ddq, fit.beta) + lib.friction(smooth, fit.f)
left = test.tau - forward
share = np.sqrt(np.mean(left[inner] ** 2, axis=0) / np.mean(test.tau[inner] ** 2, axis=0))
assert np.all(share < 0.1)
for joint, part in zip(robot.joints, share, strict=True):
    print(f"left to feedback at the {joint.name}: {100 * part:.1f} % of the torque")

# %%
time = test.time - test.time[0]
figures = [
    build_line_figure(
        f"Torque of the {joint.name}: measured, and computed in advance",
        ("time, s", "torque, N m"),
        [
            Line("measured", "measured", time[inner], test.tau[inner, k]),
            Line("feed-forward", "predicted", time[inner], forward[inner, k]),
        ],
    )
    for k, joint in enumerate(robot.joints)
]
symid.Figures(drawings=tuple(figures))

# %% [markdown]
# How much does each part of the model give? Leave one out at a time.

# %%
parts = {
    "all": forward,
    "without friction": lib.inverse_dynamics(q, smooth, ddq, fit.beta),
    "gravity only": lib.gravity(q, fit.beta),
    "nothing": np.zeros_like(forward),
}
table = {
    name: np.sqrt(np.mean((test.tau - part)[inner] ** 2, axis=0)).round(3).tolist()
    for name, part in parts.items()
}
assert table["all"][0] < table["without friction"][0] < table["gravity only"][0] < table["nothing"][0]
table

# %% [markdown]
# ## Into the controller
#
# `robot.write("c", "controller")` writes the same function as C99 without allocation; `fit.beta` and
# `fit.f` are its arguments, so that another fit needs no other code. `fit.export("identified.urdf")` writes
# bodies that have these values, for simulators.

# %%
fit.beta, fit.f

# %% [markdown]
# **To do**: (1) Identify from the first two seconds only (`train="0:25%"`): which deviations grow, and does
# the test still pass? (2) Give the arm a payload of 0.5 kg in the robot file, simulate, and use the old
# fit: where does the error show? (3) Which of the base parameters matters most for this motion?
