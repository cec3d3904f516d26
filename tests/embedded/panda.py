"""Values for the links of the Panda, whose robot file holds kinematics and limits alone.

Source: C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca: Dynamic identification of the Franka
Emika Panda robot with retrieval of feasible parameters using penalty-based optimization, IEEE Robotics and
Automation Letters 4 (2019) 4147, as the package example-robot-data has them, without flange and hand.
"""

from dataclasses import replace

import numpy as np

from symid.robot.description import Robot

# Mass; centre of mass in the link frame; xx, xy, xz, yy, yz, zz of the inertia about it.
LINKS = (
    (4.970684, (0.003875, 0.002081, -0.04762), (0.70337, -0.000139, 0.006772, 0.70661, 0.019169, 0.009117)),
    (0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, -0.003925, 0.010254, 0.02811, 0.000704, 0.025995)),
    (
        3.228604,
        (0.027518, 0.039252, -0.066502),
        (0.037242, -0.004761, -0.011396, 0.036155, -0.012805, 0.01083),
    ),
    (3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.007796, -0.001332, 0.019552, 0.008641, 0.028323)),
    (
        1.225946,
        (-0.011953, 0.041065, -0.038437),
        (0.035549, -0.002117, -0.004037, 0.029474, 0.000229, 0.008627),
    ),
    (
        1.666555,
        (0.060149, -0.014117, -0.010517),
        (0.001964, 0.000109, -0.001158, 0.004354, 0.000341, 0.005433),
    ),
    (
        0.735522,
        (0.010517, -0.004252, 0.061597),
        (0.012516, -0.000428, -0.001196, 0.010027, -0.000741, 0.004815),
    ),
)


def give_values(robot: Robot) -> Robot:
    """Return the Panda with the values of its links about their frames' origins."""
    joints = []
    for joint, (mass, place, (xx, xy, xz, yy, yz, zz)) in zip(robot.joints, LINKS, strict=True):
        com = np.array(place)
        central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about = central + mass * (com @ com * np.eye(3) - np.outer(com, com))
        inertial = (*about[np.triu_indices(3)], *(mass * com), mass)
        joints.append(replace(joint, inertial=tuple(map(float, inertial))))
    return replace(robot, joints=tuple(joints))
