"""The chapters of a lesson on elastic joints: motor and link, springs, energies, inverse, two steps.

Robot, book -> the chapters that follow those on the rigid robot. The page runs the generated step of the
springs beside them.

    link    M ddq + C dq + g = tau_J            play  P_r[x] = max(x - r, min(x + r, P_r before))
    motor   IA ddtheta + tau_f + tau_J = tau_m  stop  E_r[x] = x - P_r[x]
    spring  tau_J = S(k0 phi + sum k_i E_i[phi]),  phi = theta - q

Kuhnen 2003; Zhang and Zhang 2023 for the two-step method.
Supported: springs with stops, knees and a cubic part. Not supported: branches of other models (named only).
"""

from collections.abc import Iterator

from symid.joint_models import Elasticity
from symid.lessons.chapters import Chapter, Item
from symid.lessons.textbook import Book
from symid.robot import Robot

_PLAY = (
    r"P_r[x](t) = \max\bigl(x - r,\ \min(x + r,\ P_r(t^-))\bigr), \qquad E_r[x] = x - P_r[x], \qquad "
    r"|E_r| \le r"
)
_SPRING = r"v = k_0\,\varphi + \sum_i k_i\,E_{r_i}[\varphi], \qquad \tau_J = S(v)"
_CUBIC_SPRING = _SPRING.replace(r"\varphi +", r"\varphi + k_3\,\varphi^3 +", 1)
_DEAD = r"S(v) = v + \sum_{R_j > 0} s_j \max(v - R_j, 0) + \sum_{R_j < 0} s_j \min(v - R_j, 0)"
_STORED = r"U = \tfrac12 k_0\,\varphi^2 + \tfrac12 \sum_i k_i\,E_i^2, \qquad D = \sum_i k_i\, r_i \int |dP_i|"
_THEOREM = r"\int \tau_J\, d\varphi = U(t) - U(0) + D(t), \qquad \dot D \ge 0"
_MASING = (
    r"\tau_J - \tau_r = 2\,f\!\left(\tfrac12(\varphi - \varphi_r)\right), \qquad "
    r"f \text{ the first curve from rest}"
)
_INVERSE = (
    r"\varphi = w'_0\,v + \sum_i w'_i\,P_{r'_i}[v], \qquad v = S^{-1}(\tau_J), \qquad "
    r"w'_0 = \frac{1}{W_0}, \quad w'_i = \frac{1}{W_i} - \frac{1}{W_{i-1}}, \quad "
    r"r'_i = r'_{i-1} + W_{i-1}\,(r_i - r_{i-1})"
)
_ENERGY_ROWS = (
    r"\Delta\bigl(h_T + h_V\bigr)\,\beta + \Delta\bigl(\tfrac12 \dot\theta^2\bigr) I_a + "
    r"\int \dot\theta\, F(\dot\theta)\,dt\; f = "
    r"\int \dot\theta\,\tau_m\,dt - \int \tau_J\,\dot\varphi\,dt"
)


def write_elastic(robot: Robot, book: Book) -> Iterator[Chapter]:
    """Yield the chapters on elastic joints; none where no joint is elastic."""
    springs = [(k, joint.elasticity) for k, joint in enumerate(robot.joints, start=1) if joint.elasticity]
    if not springs:
        return
    yield _write_sides(robot, book, [number for number, _ in springs])
    yield _write_spring(springs)
    yield _write_energy(springs)
    yield _write_identification()


def _write_sides(robot: Robot, book: Book, numbers: list[int]) -> Chapter:
    q = book.coordinates
    where = "All joints are" if len(numbers) == robot.size else f"Joints {', '.join(map(str, numbers))} are"
    items = (
        Item(
            kind="text",
            text=f"{where} elastic: a gear with a flexible spline, a belt or a long shaft stands between "
            f"motor and link. The link "
            rf"is at ${q}$, the motor, seen through the gear, at $\theta$; the torsion is the difference.",
        ),
        Item(kind="formula", latex=rf"\varphi = \theta - {q}"),
        Item(
            kind="text",
            text="The equation of motion above is that of the links, with the torque of the springs on "
            "its left side; the rotors "
            "have equations of their own (Spong 1987):",
        ),
        Item(
            kind="formula",
            latex=rf"{book.mass}({q})\,\ddot {q} + {book.coriolis}({q},\dot {q})\,\dot {q} + "
            rf"{book.gravity}({q}) = \tau_J",
        ),
        Item(kind="formula", latex=r"I_a\,\ddot\theta + \tau_f(\dot\theta) + \tau_J = \tau_m"),
        Item(kind="widget", text="sides"),
    )
    return Chapter(title="Motor and link", anchor="sides", items=items)


def _write_values(elasticity: Elasticity, number: int) -> tuple[tuple[str, ...], ...]:
    rows = [(str(number), "$k_0$", "-", f"{elasticity.stiffness:g}" if elasticity.stiffness else "open")]
    for k, stop in enumerate(elasticity.stops, start=1):
        value = "open" if stop.stiffness is None else f"{stop.stiffness:g}"
        rows.append((str(number), f"stop $k_{k}$", f"$r_{k}$ = {stop.threshold:g} rad", value))
    rows += [
        (str(number), f"knee $s_{k}$", f"$R_{k}$ = {knee.threshold:g} N m", f"{knee.slope:g}")
        for k, knee in enumerate(elasticity.knees, start=1)
    ]
    return tuple(rows)


def _write_spring(springs: list[tuple[int, Elasticity]]) -> Chapter:
    cubic = any(spring.cubic for _, spring in springs)
    head = ("joint", "part", "threshold", "stiffness, N m/rad (knees: slope)")
    rows = (head, *(row for number, spring in springs for row in _write_values(spring, number)))
    others = sorted({branch.kind for _, spring in springs for branch in spring.branches})
    items = [
        Item(
            kind="text",
            text="A spring behind dry friction holds until its own torsion reaches its threshold, then "
            "slips. That is the stop "
            "operator; what it lags behind is the play. A few of them beside a plain spring make a loop "
            "of any shape with "
            "memory (Prandtl 1928, Ishlinskii 1944); a function behind makes it harden (modified "
            "Prandtl-Ishlinskii model, Kuhnen 2003).",
        ),
        Item(kind="formula", latex=_PLAY),
        Item(kind="formula", latex=_CUBIC_SPRING if cubic else _SPRING),
        Item(kind="formula", latex=_DEAD),
        Item(kind="table", rows=rows),
        Item(kind="widget", text="hysteresis"),
        Item(
            kind="text",
            text="Drag the torsion: from rest the torque follows the first curve. After each reversal "
            "every stop has to give back "
            "twice its threshold before it slips again, so the branch is the first curve at twice its "
            "size, until it meets the curve that it left before (Masing 1926):",
        ),
        Item(kind="formula", latex=_MASING),
    ]
    if others:
        items.append(
            Item(
                kind="text", text=f"Beside these the file has branches of other models: {', '.join(others)}."
            )
        )
    return Chapter(title="Springs that remember", anchor="springs", items=tuple(items))


def _write_energy(springs: list[tuple[int, Elasticity]]) -> Chapter:
    knees = any(spring.knees for _, spring in springs)
    items = [
        Item(
            kind="text",
            text="What the torque does on the torsion is stored in the springs or lost in the stops that "
            "slip. " + ("Without knees" if knees else "Here"),
        ),
        Item(kind="formula", latex=_STORED),
        Item(kind="formula", latex=_THEOREM),
        Item(kind="widget", text="balance"),
        Item(
            kind="text",
            text="The spring can be turned round: the inverse is a sum of plays again, in closed form. A "
            "controller "
            r"computes with it the torsion that a wanted torque needs. With $W_i = k_0 + \sum_{j>i} k_j$, "
            r"$r_0 = r'_0 = 0$:",
        ),
        Item(kind="formula", latex=_INVERSE),
        Item(kind="widget", text="inverse"),
    ]
    return Chapter(
        title="Energy of the springs, and their inverse", anchor="springs-energy", items=tuple(items)
    )


def _write_identification() -> Chapter:
    items = (
        Item(
            kind="text",
            text="Dynamics and springs are unknown together, and their product is no linear problem. The "
            "two-step method "
            "(after Zhang and Zhang 2023) takes turns. First, with the springs held, energy rows are "
            "linear in the base parameters, "
            "rotors and friction:",
        ),
        Item(kind="formula", latex=_ENERGY_ROWS),
        Item(
            kind="text",
            text="Then, with those held, the motor's equation gives the torque of each spring, and "
            "stiffness and stops are "
            "linear in it for given thresholds:",
        ),
        Item(
            kind="formula",
            latex=r"\tau_J = \tau_m - I_a\,\ddot\theta - \tau_f(\dot\theta) \approx k_0\,\varphi + \sum_i "
            r"k_i\,E_{r_i}[\varphi]",
        ),
        Item(
            kind="text",
            text="The steps alternate until nothing changes; `symid identify` compares it with four other "
            "methods.",
        ),
    )
    return Chapter(title="The two-step method", anchor="two-step", items=items)
