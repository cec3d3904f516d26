"""Friction of one joint at a time: samples, laws fitted to them, the choice of a law."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.friction.estimators import (
        SEARCHES as SEARCHES,
        build_estimate as build_estimate,
        fit_friction as fit_friction,
    )
    from symid.identification.friction.identify import (
        AUTO as AUTO,
        FrictionIdentification as FrictionIdentification,
        FrictionTask as FrictionTask,
        JointFriction as JointFriction,
        build_robot_friction as build_robot_friction,
        identify_friction as identify_friction,
        set_identified_friction as set_identified_friction,
        validate_friction as validate_friction,
    )
    from symid.identification.friction.joint_fit import (
        FrictionEstimate as FrictionEstimate,
        FrictionSamples as FrictionSamples,
        FrictionSearch as FrictionSearch,
        compute_sensitivities as compute_sensitivities,
        compute_uncertainty as compute_uncertainty,
        is_one_sided as is_one_sided,
    )
    from symid.identification.friction.poses import CONFIDENCE as CONFIDENCE, PoseTest as PoseTest
    from symid.identification.friction.searches import (
        FrictionOptions as FrictionOptions,
        FrictionProblem as FrictionProblem,
        Projection as Projection,
        Projector as Projector,
        build_problem as build_problem,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
