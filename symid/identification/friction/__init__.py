"""Friction of one joint at a time: samples, laws fitted to them, the choice of a law."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.friction.estimators import (
        ESTIMATORS as ESTIMATORS,
        STOCHASTIC as STOCHASTIC,
        fit_friction as fit_friction,
        search_friction as search_friction,
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
        compute_cramer_rao as compute_cramer_rao,
        compute_law_sensitivities as compute_law_sensitivities,
    )
    from symid.identification.friction.output_error import (
        AxisModel as AxisModel,
        SearchPlan as SearchPlan,
        build_axis_run as build_axis_run,
        build_axis_samples as build_axis_samples,
        choose_axis_trial as choose_axis_trial,
        compute_window_rmse as compute_window_rmse,
        fit_whole_run as fit_whole_run,
        simulate_axis as simulate_axis,
        try_axis_model as try_axis_model,
    )
    from symid.identification.friction.poses import CONFIDENCE as CONFIDENCE, PoseTest as PoseTest
    from symid.identification.friction.presliding import fit_presliding as fit_presliding
    from symid.identification.friction.problem import (
        FrictionOptions as FrictionOptions,
        build_problem as build_problem,
    )
    from symid.identification.friction.selection import compute_relative_residual as compute_relative_residual
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
