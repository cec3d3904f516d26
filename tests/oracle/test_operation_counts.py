"""Products and sums of the generated functions: no more than the best published counts, nor than reached.

A bound of the first table is what other tools and customised recursions need; one of the second is what
symid reached, so that no change makes it worse unseen. Forward dynamics inverts each pivot once: a product
more a joint, and as many quotients fewer as there are pairs of joints.
"""

import pytest

from symid.codegen.routes import count_route_operations
from tests.chains import KR30, LWR4, PANDA, PUMA560, TWO_LINK, UR5

PUBLISHED = """
function         2R    PUMA560 KR30    LWR4+   Panda
inverse_dynamics 23+15 301+240 -       343+271 361+288
mass_matrix      -     208+173 -       226+181 274+225
torque_regressor -     444+325 466+345 713+499 762+543
energy_regressor -     120+53  -       134+58  145+69
"""
REACHED = """
function                     2R    PUMA560   KR30      LWR4+     Panda     UR5
forward_kinematics           6+2   61+30     64+34     68+31     77+41     64+34
jacobian                     2+0   51+23     66+39     66+29     93+55     65+39
mass_matrix                  3+4   145+128   135+122   160+132   182+159   137+123
coriolis_matrix              6+3   501+473   484+456   612+551   674+617   462+448
gravity                      10+5  46+26     60+38     60+36     60+36     44+24
bias                         15+8  226+211   237+222   262+251   279+267   219+203
inverse_dynamics             19+13 241+236   251+246   268+266   285+282   241+237
forward_dynamics             25+14 448+402   452+410   538+478   577+521   436+392
inverse_dynamics_derivatives 23+17 1028+987  1021+975  1246+1139 1342+1243 956+942
forward_dynamics_derivatives 56+35 1648+1487 1683+1511 2208+1941 2304+2045 1574+1442
mass_matrix_derivatives      3+1   342+340   333+313   457+393   515+491   311+304
energy                       18+8  137+81    148+91    153+90    161+97    137+82
energy_regressor             15+3  111+39    120+45    126+41    134+48    111+40
momentum_regressor           7+3   254+130   239+131   420+198   441+238   203+116
lagrange_regressor           11+5  318+186   316+193   574+312   585+346   244+166
torque_regressor             16+10 375+285   375+287   616+445   644+475   319+251
slotine_li_regressor         16+11 433+322   433+324   686+490   714+520   377+288
"""
ROBOTS = {"2R": TWO_LINK, "PUMA560": PUMA560, "KR30": KR30, "LWR4+": LWR4, "Panda": PANDA, "UR5": UR5}


def read_table(text):
    """Return {robot: {function: (products, sums)}}."""
    (_, *robots), *rows = (line.split() for line in text.strip().splitlines())
    return {
        robot: {row[0]: tuple(map(int, row[k].split("+"))) for row in rows if row[k] != "-"}
        for k, robot in enumerate(robots, start=1)
    }


def count_chosen(robot):
    return {
        count.function: (count.operations.mul, count.operations.add)
        for count in count_route_operations(robot)
        if count.chosen
    }


@pytest.fixture(scope="module")
def counts():
    return {name: count_chosen(robot) for name, robot in ROBOTS.items()}


def test_routes_that_large_robots_leave_out_are_chosen_for_none_with_six_joints(counts, monkeypatch):
    monkeypatch.setattr("symid.codegen.routes._MOST_TRIED", 0)
    for name in ("PUMA560", "KR30"):
        assert count_chosen(ROBOTS[name]) == counts[name]


@pytest.mark.parametrize("table", [PUBLISHED, REACHED], ids=["published", "reached"])
def test_counts_stay_below_those_of_the_table(counts, table):
    bounds = read_table(table)
    assert [
        f"{robot} {function}: {counts[robot][function]} > {bound}"
        for robot, functions in bounds.items()
        for function, bound in functions.items()
        if any(found > most for found, most in zip(counts[robot][function], bound, strict=True))
    ] == []
    if table is REACHED:
        assert {name: set(entry) for name, entry in bounds.items()} == {
            name: set(entry) for name, entry in counts.items()
        }
