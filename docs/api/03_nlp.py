"""Which pose loads the shoulder most, while the motor of the elbow holds no more than 2 N m?"""

import casadi as ca

import symid

opti, gravity = ca.Opti(), symid.load("two_link").casadi("gravity", constant=True)
q = opti.variable(2)
opti.minimize(-gravity(q)[0])
opti.subject_to(opti.bounded(-2, gravity(q)[1], 2))
opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
print(opti.solve().value(ca.vertcat(q, gravity(q))).round(3))
