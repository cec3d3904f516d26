"""Springs with hysteresis as CasADi functions: torque of a torsion, torsion of a torque, slopes."""

import casadi as ca
import numpy as np
from scipy.integrate import trapezoid

import symid

robot = symid.load("two_link_elastic")
spring, inverse = robot.casadi("hysteresis_step"), robot.casadi("hysteresis_inverse_step")
h = robot.compile().h  # the parameters of the springs that the robot file states

# Two periods of torsion, rad. `mapaccum` walks along the samples and hands the memory of the springs on: the
# second output of a step is the second input of the next one.
time = np.linspace(0.0, 2.0, 401)
torsion = np.outer([0.015, 0.012], np.sin(2.0 * np.pi * time))
walk, return_walk = (each.mapaccum("walk", len(time), [1], [1], {}) for each in (spring, inverse))
torque = walk(torsion, np.zeros(6), h)[0]
back = return_walk(torque, np.zeros(6), h)[0]
print("from torsion to torque and back:", np.allclose(back.full(), torsion, rtol=0.0, atol=1e-12))

loop = torque.full()[0, 200:], torsion[0, 200:]
print(f"the shoulder loses {trapezoid(*loop):.4f} J in each period")

phi = ca.MX.sym("phi", 2)
slope = ca.Function("slope", [phi], [ca.diag(ca.jacobian(spring(phi, np.zeros(6), h)[0], phi))])
print("stiffness at the start, at 4 mrad and at 12 mrad, N m/rad:")
print(np.hstack([slope([part, part]).full() for part in (0.0001, 0.004, 0.012)]).round(1))
