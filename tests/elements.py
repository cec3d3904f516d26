"""Elements with hysteresis, one of every kind."""

from symid.joint_models import (
    AttractedSlip,
    BoucWen,
    BristleBranch,
    Elasticity,
    Knee,
    Relaxation,
    Relays,
    SlipSpring,
    Stop,
)

STOPS = (Stop(threshold=0.1, stiffness=2.0), Stop(threshold=0.3, stiffness=1.0))
KNEES = (Knee(threshold=-1.0, slope=0.5), Knee(threshold=0.5, slope=-0.3))
LUGRE = {"Fc": 2.0, "Fe": 0.5, "vs": 0.5, "gamma": 2.0, "Fv": 3.0, "sigma0": 30.0, "sigma1": 0.4}
SLIP = {"Fc": 2.0, "stiffness1": 30.0, "stiffness2": 10.0, "share1": 0.4, "share2": 0.6}


def spring(*branches, stiffness=1.0):
    return Elasticity(stiffness=stiffness, branches=branches)


_RELAYS = Relays(low=-1.0, step=0.5, ramps=(0.5, 1.0, 1.0, 0.5), weights=(0.3, 0.2, 0.4, 0.1, 0.1, 0.2))
_ATTRACTED = {"thresholds": (0.05, 0.2), "stiffnesses": (20.0, 5.0), "excess": 0.4, "speed": 1.0}
ELEMENTS = {
    "stops": Elasticity(stiffness=3.0, stops=STOPS, offset=0.2),
    "knees": Elasticity(stiffness=3.0, stops=STOPS, knees=KNEES),
    "cubic": Elasticity(stiffness=3.0, cubic=2.0, stops=STOPS, damping=0.01),
    "slip": spring(SlipSpring(deflections=(-0.2, -0.05, 0.05, 0.2), forces=(-4.0, -0.1, 0.1, 3.0))),
    "falling": spring(SlipSpring(deflections=(-0.2, 0.0, 0.2), forces=(-4.0, 0.0, 3.0), falls=(0.1, 0.02))),
    "relays": spring(_RELAYS, stiffness=2.0),
    "bouc-wen": spring(BoucWen(level=2.0, length=0.1, sharpness=1.6, loop=0.8, skew=0.3)),
    "dahl": spring(BristleBranch(law="dahl", values=(("Fc", 2.0), ("sigma0", 30.0)))),
    "lugre": spring(BristleBranch(law="lugre", values=tuple(LUGRE.items()))),
    "maxwell-slip": spring(BristleBranch(law="maxwell-slip", values=tuple(SLIP.items()))),
    "attracted": spring(AttractedSlip(**_ATTRACTED, attraction=20.0)),
    "two": spring(Relaxation(stiffness=5.0, time=0.02), BoucWen(level=2.0, length=0.1)),
    "gap": Elasticity(stiffness=3.0, stops=STOPS, backlash=0.05),
}
