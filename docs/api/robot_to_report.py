# %% [markdown]
# # From a robot to a report
#
# Everything here goes through `import symid`: the dynamics of a two-link arm, logs, the parameters identified
# from them, a validation, files for other programs and a report. SI units: rad, N m, kg m².
#
# The logs are simulated, so that the truth is known. With a robot of your own, `symid.read_log(file, robot)`
# takes their place.

# %%
import symid

robot = symid.load("two_link")
robot

# %% [markdown]
# ## What can be known of it
#
# Torques show combinations of masses and inertias only, the base parameters. They are found exactly, each
# with the reason.

# %%
robot.base

# %%
robot.base.explain("MXR1")

# %% [markdown]
# ## Exact dynamics
#
# Every function of the robot is there as SymPy expressions, linear in these parameters.

# %%
mass_matrix = robot.sympy("mass_matrix")
mass_matrix

# %%
robot.sympy("gravity")

# %% [markdown]
# The same functions as compiled C, for one sample or for many:

# %%
lib = robot.compile()
lib.mass_matrix([0.0, 1.0], lib.beta)

# %% [markdown]
# ## Logs
#
# Twenty seconds on a random trajectory for the fit, and another motion to try it on; the torque sensors have
# a noise of 0.05 N m.

# %%
train = robot.simulate(seed=1).log
test = robot.simulate("tc", seed=2).log
train

# %% [markdown]
# Is the log good enough?

# %%
robot.check(train)

# %% [markdown]
# ## The fit

# %%
fit = robot.identify(train, estimator="wls")
fit

# %% [markdown]
# One parameter with its standard deviation, and how two depend on each other:

# %%
print(fit["ZZ2"], fit["Fc1"], sep="\n")
names = list(fit)
fit.covariance[names.index("ZZ2"), names.index("MX2")] / (fit["ZZ2"].std * fit["MX2"].std)

# %% [markdown]
# ## Does it hold for another motion?
#
# Nothing is fitted here: the torques are predicted. A mean residual beyond 5 % would be called an error.

# %%
validation = fit.validate(test, gate=5.0)
validation

# %% [markdown]
# ## Friction by itself
#
# Which law do the joints follow? `model="auto"` compares fourteen; here one is asked for.

# %%
friction = robot.identify_friction(train, model="asymmetric")
friction

# %% [markdown]
# ## Files for other programs, and the report

# %%
fit.export("identified.urdf")

# %%
fit.save("fit.json")
fit.report("report.html", validation=test)
