"""What a joint does besides moving its link: friction, springs, hysteresis."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.joint_models.dynamic_friction import (
        DynamicLaw as DynamicLaw,
        FrictionPath as FrictionPath,
        build_held_path as build_held_path,
        check_dynamic_values as check_dynamic_values,
        compute_bristle_rate as compute_bristle_rate,
        compute_bristle_step as compute_bristle_step,
        compute_dynamic_torque as compute_dynamic_torque,
        compute_largest_level as compute_largest_level,
        compute_torque_derivatives as compute_torque_derivatives,
        get_dynamic_law as get_dynamic_law,
        simulate_dynamic_friction as simulate_dynamic_friction,
    )
    from symid.joint_models.friction_catalogue import FRICTION_LAWS as FRICTION_LAWS, get_law as get_law
    from symid.joint_models.friction_columns import (
        STRIBECK_PARAMETERS as STRIBECK_PARAMETERS,
        StribeckCarrier as StribeckCarrier,
        compute_stribeck_derivatives as compute_stribeck_derivatives,
    )
    from symid.joint_models.friction_law import (
        FrictionCarrier as FrictionCarrier,
        FrictionLaw as FrictionLaw,
        LawParameter as LawParameter,
        OperatorFriction as OperatorFriction,
        build_float_carrier as build_float_carrier,
        build_numpy_carrier as build_numpy_carrier,
        compute_column_derivatives as compute_column_derivatives,
        compute_columns as compute_columns,
        compute_friction_torque as compute_friction_torque,
    )
    from symid.joint_models.friction_models import (
        FRICTION_MODELS as FRICTION_MODELS,
        build_friction_rows as build_friction_rows,
        compute_constant_torques as compute_constant_torques,
        compute_friction_columns as compute_friction_columns,
        get_friction as get_friction,
        list_friction_parameters as list_friction_parameters,
    )
    from symid.joint_models.hysteresis import (
        SpringTerms as SpringTerms,
        advance_inverse_spring as advance_inverse_spring,
        advance_spring as advance_spring,
        compute_outer_function as compute_outer_function,
        invert_spring as invert_spring,
    )
    from symid.joint_models.prandtl_ishlinskii import (
        compute_first_curve as compute_first_curve,
        compute_hysteresis_torque as compute_hysteresis_torque,
        compute_plays as compute_plays,
        compute_spring_work as compute_spring_work,
        compute_stop_basis as compute_stop_basis,
        compute_work_columns as compute_work_columns,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
