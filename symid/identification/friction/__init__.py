"""Friction of one joint at a time: samples, laws fitted to them, the choice of a law."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.friction.estimate import (
        FrictionEstimate as FrictionEstimate,
        compute_cramer_rao as compute_cramer_rao,
        compute_sensitivities as compute_sensitivities,
    )
    from symid.identification.friction.estimators import (
        ESTIMATORS as ESTIMATORS,
        STOCHASTIC as STOCHASTIC,
        fit_friction as fit_friction,
        search_friction as search_friction,
    )
    from symid.identification.friction.identify import (
        AUTO as AUTO,
        FrictionTask as FrictionTask,
        identify_friction as identify_friction,
    )
    from symid.identification.friction.poses import CONFIDENCE as CONFIDENCE, PoseTest as PoseTest
    from symid.identification.friction.presliding import fit_presliding as fit_presliding
    from symid.identification.friction.problem import (
        FrictionOptions as FrictionOptions,
        VariableProjectionOptions as VariableProjectionOptions,
        build_problem as build_problem,
    )
    from symid.identification.friction.results import (
        FrictionIdentification as FrictionIdentification,
        JointFriction as JointFriction,
        build_robot_friction as build_robot_friction,
        describe_obstacle as describe_obstacle,
        is_friction_result as is_friction_result,
        read_friction_result as read_friction_result,
        set_identified_friction as set_identified_friction,
        write_friction_result as write_friction_result,
    )
    from symid.identification.friction.samples import FrictionSamples as FrictionSamples
    from symid.identification.friction.selection import LawSelection as LawSelection
    from symid.identification.friction.validation import (
        check_friction_model as check_friction_model,
        check_friction_robot as check_friction_robot,
        validate_friction as validate_friction,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
