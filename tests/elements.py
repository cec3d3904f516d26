"""Elements with hysteresis, one of every kind."""

from symid import joint_models

STOPS = (joint_models.Stop(threshold=0.1, stiffness=2.0), joint_models.Stop(threshold=0.3, stiffness=1.0))
KNEES = (joint_models.Knee(threshold=-1.0, slope=0.5), joint_models.Knee(threshold=0.5, slope=-0.3))
LUGRE = {"Fc": 2.0, "Fe": 0.5, "vs": 0.5, "gamma": 2.0, "Fv": 3.0, "sigma0": 30.0, "sigma1": 0.4}
SLIP = {"Fc": 2.0, "stiffness1": 30.0, "stiffness2": 10.0, "share1": 0.4, "share2": 0.6}


def spring(*branches, stiffness=1.0):
    return joint_models.Elasticity(stiffness=stiffness, branches=branches)


_RELAYS = joint_models.Relays(
    low=-1.0, step=0.5, ramps=(0.5, 1.0, 1.0, 0.5), weights=(0.3, 0.2, 0.4, 0.1, 0.1, 0.2)
)
_ATTRACTED = {"thresholds": (0.05, 0.2), "stiffnesses": (20.0, 5.0), "excess": 0.4, "speed": 1.0}
ELEMENTS = {
    "stops": joint_models.Elasticity(stiffness=3.0, stops=STOPS, offset=0.2),
    "knees": joint_models.Elasticity(stiffness=3.0, stops=STOPS, knees=KNEES),
    "cubic": joint_models.Elasticity(stiffness=3.0, cubic=2.0, stops=STOPS, damping=0.01),
    "slip": spring(
        joint_models.SlipSpring(deflections=(-0.2, -0.05, 0.05, 0.2), forces=(-4.0, -0.1, 0.1, 3.0))
    ),
    "falling": spring(
        joint_models.SlipSpring(deflections=(-0.2, 0.0, 0.2), forces=(-4.0, 0.0, 3.0), falls=(0.1, 0.02))
    ),
    "relays": spring(_RELAYS, stiffness=2.0),
    "bouc-wen": spring(joint_models.BoucWen(level=2.0, length=0.1, sharpness=1.6, loop=0.8, skew=0.3)),
    "dahl": spring(joint_models.BristleBranch(law="dahl", values=(("Fc", 2.0), ("sigma0", 30.0)))),
    "lugre": spring(joint_models.BristleBranch(law="lugre", values=tuple(LUGRE.items()))),
    "maxwell-slip": spring(joint_models.BristleBranch(law="maxwell-slip", values=tuple(SLIP.items()))),
    "attracted": spring(joint_models.AttractedSlip(**_ATTRACTED, attraction=20.0)),
    "two": spring(
        joint_models.Relaxation(stiffness=5.0, time=0.02), joint_models.BoucWen(level=2.0, length=0.1)
    ),
    "gap": joint_models.Elasticity(stiffness=3.0, stops=STOPS, backlash=0.05),
}
