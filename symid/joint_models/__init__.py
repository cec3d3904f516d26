"""What a joint does besides moving its link: friction, springs, hysteresis."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.joint_models.branches import (
        AttractedSlip as AttractedSlip,
        BoucWen as BoucWen,
        Branch as Branch,
        BristleBranch as BristleBranch,
        Relaxation as Relaxation,
        Relays as Relays,
        SlipSpring as SlipSpring,
    )
    from symid.joint_models.carriers import (
        Carrier as Carrier,
        OperatorCarrier as OperatorCarrier,
        build_casadi_carrier as build_casadi_carrier,
        build_float_carrier as build_float_carrier,
        build_numpy_carrier as build_numpy_carrier,
        smooth as smooth,
    )
    from symid.joint_models.dynamic_friction import (
        advance_memory as advance_memory,
        build_memory_values as build_memory_values,
        convert_printed as convert_printed,
        count_states as count_states,
        derive_equations as derive_equations,
        is_passive as is_passive,
        list_memory_values as list_memory_values,
        list_state_parameters as list_state_parameters,
        name_bristles as name_bristles,
        simulate_dynamic_friction as simulate_dynamic_friction,
        write_dynamic_latex as write_dynamic_latex,
    )
    from symid.joint_models.element import (
        BranchPath as BranchPath,
        ElementStep as ElementStep,
        Start as Start,
        SteppedBranch as SteppedBranch,
        advance_element as advance_element,
        build_branch_step as build_branch_step,
        describe_inverse as describe_inverse,
        describe_value as describe_value,
        find_least_slope as find_least_slope,
        find_most_slope as find_most_slope,
        has_closed_inverse as has_closed_inverse,
        invert_element as invert_element,
        invert_step as invert_step,
        is_passive_element as is_passive_element,
        list_element_values as list_element_values,
        needs_time as needs_time,
        run_branch as run_branch,
        run_element as run_element,
        start_element as start_element,
        start_states as start_states,
        strip_branch as strip_branch,
        trace_branch as trace_branch,
        write_value_unit as write_value_unit,
    )
    from symid.joint_models.friction_catalogue import (
        FRICTION_LAWS as FRICTION_LAWS,
        STATE_LAWS as STATE_LAWS,
        describe_unknown_law as describe_unknown_law,
        fix_exponent as fix_exponent,
        free_exponent as free_exponent,
        get_friction_law as get_friction_law,
        get_law as get_law,
        has_sign as has_sign,
        is_braking as is_braking,
        list_known_laws as list_known_laws,
        list_shape_names as list_shape_names,
        list_value_names as list_value_names,
        name_shape as name_shape,
        name_values as name_values,
        rename_law as rename_law,
    )
    from symid.joint_models.friction_law import (
        NO_FRICTION as NO_FRICTION,
        REFERENCE_TEMPERATURE as REFERENCE_TEMPERATURE,
        FrictionLaw as FrictionLaw,
        FrictionValues as FrictionValues,
        compute_column_derivatives as compute_column_derivatives,
        compute_columns as compute_columns,
        compute_friction_torque as compute_friction_torque,
        compute_law_sensitivities as compute_law_sensitivities,
        compute_stribeck_derivatives as compute_stribeck_derivatives,
    )
    from symid.joint_models.hysteresis import (
        Elasticity as Elasticity,
        Knee as Knee,
        MaxwellElement as MaxwellElement,
        SpringTerms as SpringTerms,
        Stop as Stop,
        advance_inverse_spring as advance_inverse_spring,
        advance_spring as advance_spring,
        compute_catalogue_knees as compute_catalogue_knees,
        compute_outer_function as compute_outer_function,
        compute_play as compute_play,
        convert_maxwell_elements as convert_maxwell_elements,
        invert_spring as invert_spring,
    )
    from symid.joint_models.prandtl_ishlinskii import (
        PlayPath as PlayPath,
        compute_clamps as compute_clamps,
        compute_hysteresis_torque as compute_hysteresis_torque,
        compute_plays as compute_plays,
        compute_spring_work as compute_spring_work,
        compute_stop_basis as compute_stop_basis,
        compute_work_columns as compute_work_columns,
        find_turns as find_turns,
        invert_hysteresis as invert_hysteresis,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
