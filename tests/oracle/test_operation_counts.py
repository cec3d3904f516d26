"""Products and sums of the generated functions: no more than the best published counts, nor than reached.

A bound of the first table is what other tools and customised recursions need; one of the second is what
symid reached, so that no change makes it worse unseen. Forward dynamics inverts each pivot once: a product
more a joint, and as many quotients fewer as there are pairs of joints.
"""

import pytest

from symid.codegen.routes import count_route_operations
from tests.chains import KR30, LWR4, PANDA, PUMA560, TWO_LINK, UR5

PUBLISHED = {
    "2R": {"inverse_dynamics": (23, 15)},
    "PUMA560": {
        "inverse_dynamics": (301, 240),
        "mass_matrix": (208, 173),
        "torque_regressor": (444, 325),
        "energy_regressor": (120, 53),
    },
    "KR30": {"torque_regressor": (466, 345)},
    "LWR4+": {
        "inverse_dynamics": (343, 271),
        "mass_matrix": (226, 181),
        "torque_regressor": (713, 499),
        "energy_regressor": (134, 58),
    },
    "Panda": {
        "inverse_dynamics": (361, 288),
        "mass_matrix": (274, 225),
        "torque_regressor": (762, 543),
        "energy_regressor": (145, 69),
    },
}
REACHED = {
    "2R": {
        "forward_kinematics": (6, 2),
        "jacobian": (2, 0),
        "mass_matrix": (3, 4),
        "coriolis_matrix": (6, 3),
        "gravity": (10, 5),
        "bias": (15, 8),
        "inverse_dynamics": (19, 13),
        "forward_dynamics": (25, 14),
        "inverse_dynamics_derivatives": (23, 17),
        "forward_dynamics_derivatives": (56, 35),
        "mass_matrix_derivatives": (3, 1),
        "energy": (18, 8),
        "energy_regressor": (15, 3),
        "momentum_regressor": (7, 3),
        "lagrange_regressor": (11, 5),
        "torque_regressor": (16, 10),
        "slotine_li_regressor": (16, 11),
    },
    "PUMA560": {
        "forward_kinematics": (61, 30),
        "jacobian": (51, 23),
        "mass_matrix": (145, 128),
        "coriolis_matrix": (501, 473),
        "gravity": (46, 26),
        "bias": (226, 211),
        "inverse_dynamics": (241, 236),
        "forward_dynamics": (448, 402),
        "inverse_dynamics_derivatives": (1028, 987),
        "forward_dynamics_derivatives": (1648, 1487),
        "mass_matrix_derivatives": (342, 340),
        "energy": (137, 81),
        "energy_regressor": (111, 39),
        "momentum_regressor": (254, 130),
        "lagrange_regressor": (318, 186),
        "torque_regressor": (375, 285),
        "slotine_li_regressor": (433, 322),
    },
    "KR30": {
        "forward_kinematics": (64, 34),
        "jacobian": (66, 39),
        "mass_matrix": (135, 122),
        "coriolis_matrix": (484, 456),
        "gravity": (60, 38),
        "bias": (237, 222),
        "inverse_dynamics": (251, 246),
        "forward_dynamics": (452, 410),
        "inverse_dynamics_derivatives": (1021, 975),
        "forward_dynamics_derivatives": (1683, 1511),
        "mass_matrix_derivatives": (333, 313),
        "energy": (148, 91),
        "energy_regressor": (120, 45),
        "momentum_regressor": (239, 131),
        "lagrange_regressor": (316, 193),
        "torque_regressor": (375, 287),
        "slotine_li_regressor": (433, 324),
    },
    "LWR4+": {
        "forward_kinematics": (68, 31),
        "jacobian": (66, 29),
        "mass_matrix": (160, 132),
        "coriolis_matrix": (612, 551),
        "gravity": (60, 36),
        "bias": (262, 251),
        "inverse_dynamics": (268, 266),
        "forward_dynamics": (538, 478),
        "inverse_dynamics_derivatives": (1246, 1139),
        "forward_dynamics_derivatives": (2208, 1941),
        "mass_matrix_derivatives": (457, 393),
        "energy": (153, 90),
        "energy_regressor": (126, 41),
        "momentum_regressor": (420, 198),
        "lagrange_regressor": (574, 312),
        "torque_regressor": (616, 445),
        "slotine_li_regressor": (686, 490),
    },
    "Panda": {
        "forward_kinematics": (77, 41),
        "jacobian": (93, 55),
        "mass_matrix": (182, 159),
        "coriolis_matrix": (674, 617),
        "gravity": (60, 36),
        "bias": (279, 267),
        "inverse_dynamics": (285, 282),
        "forward_dynamics": (577, 521),
        "inverse_dynamics_derivatives": (1342, 1243),
        "forward_dynamics_derivatives": (2304, 2045),
        "mass_matrix_derivatives": (515, 491),
        "energy": (161, 97),
        "energy_regressor": (134, 48),
        "momentum_regressor": (441, 238),
        "lagrange_regressor": (585, 346),
        "torque_regressor": (644, 475),
        "slotine_li_regressor": (714, 520),
    },
    "UR5": {
        "forward_kinematics": (64, 34),
        "jacobian": (65, 39),
        "mass_matrix": (137, 123),
        "coriolis_matrix": (462, 448),
        "gravity": (44, 24),
        "bias": (219, 203),
        "inverse_dynamics": (241, 237),
        "forward_dynamics": (436, 392),
        "inverse_dynamics_derivatives": (956, 942),
        "forward_dynamics_derivatives": (1574, 1442),
        "mass_matrix_derivatives": (311, 304),
        "energy": (137, 82),
        "energy_regressor": (111, 40),
        "momentum_regressor": (203, 116),
        "lagrange_regressor": (244, 166),
        "torque_regressor": (319, 251),
        "slotine_li_regressor": (377, 288),
    },
}
ROBOTS = {
    "2R": TWO_LINK,
    "PUMA560": PUMA560,
    "KR30": KR30,
    "LWR4+": LWR4,
    "Panda": PANDA,
    "UR5": UR5,
}


@pytest.fixture(scope="module")
def counts():
    return {
        name: {
            count.function: (count.operations.mul, count.operations.add)
            for count in count_route_operations(robot)
            if count.chosen
        }
        for name, robot in ROBOTS.items()
    }


def test_routes_that_large_robots_leave_out_are_chosen_for_none_with_six_joints(counts, monkeypatch):
    monkeypatch.setattr("symid.codegen.routes._MOST_TRIED", 0)
    for name in ("PUMA560", "KR30"):
        chosen = {
            count.function: count.operations for count in count_route_operations(ROBOTS[name]) if count.chosen
        }
        assert {function: (entry.mul, entry.add) for function, entry in chosen.items()} == counts[name]


def find_excess(counts, bounds):
    return [
        f"{robot} {function}: {counts[robot][function]} > {bound}"
        for robot, functions in bounds.items()
        for function, bound in functions.items()
        if any(found > most for found, most in zip(counts[robot][function], bound, strict=True))
    ]


def test_counts_stay_below_the_published_ones(counts):
    assert find_excess(counts, PUBLISHED) == []


def test_counts_stay_as_low_as_they_were(counts):
    assert {robot: set(functions) for robot, functions in REACHED.items()} == {
        robot: set(functions) for robot, functions in counts.items()
    }
    assert find_excess(counts, REACHED) == []
