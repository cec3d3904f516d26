"""Exact expressions derived from the description, base parameters with their reasons, consistent bodies."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.dynamics import (
        frame_choice as frame_choice,
        newton_euler as newton_euler,
        regressors as regressors,
        torque_derivatives as torque_derivatives,
    )
    from symid.dynamics.algebra import (
        Algebra as Algebra,
        FloatAlgebra as FloatAlgebra,
        Label as Label,
        Matrix as Matrix,
        RobotState as RobotState,
        Vector as Vector,
        build_state as build_state,
        spread_coordinates as spread_coordinates,
    )
    from symid.dynamics.base_parameters import (
        BASE_FORMS as BASE_FORMS,
        BaseParameter as BaseParameter,
        BaseParameters as BaseParameters,
        build_grouping as build_grouping,
        build_standard_parameters as build_standard_parameters,
        compute_parameter_values as compute_parameter_values,
        derive_base_parameters as derive_base_parameters,
        derive_parameter_formulas as derive_parameter_formulas,
    )
    from symid.dynamics.bodies import (
        DRIVE_PARAMETERS as DRIVE_PARAMETERS,
        add_bodies as add_bodies,
        compute_drive_energy as compute_drive_energy,
        compute_mass_matrix as compute_mass_matrix,
        gather_body as gather_body,
        list_drive_parameters as list_drive_parameters,
        move_from_stated_frames as move_from_stated_frames,
        transform_body as transform_body,
    )
    from symid.dynamics.exact_algebra import (
        ExactAlgebra as ExactAlgebra,
        PointAlgebra as PointAlgebra,
        build_basis as build_basis,
        build_exact_algebra as build_exact_algebra,
        build_power_function as build_power_function,
        choose_domain as choose_domain,
        differentiate as differentiate,
        list_symbols as list_symbols,
        split_polynomial as split_polynomial,
        write_name_latex as write_name_latex,
        write_polynomial as write_polynomial,
    )
    from symid.dynamics.explanations import (
        get_label_unit as get_label_unit,
        get_owner as get_owner,
        write_label as write_label,
    )
    from symid.dynamics.frame_choice import choose_reading as choose_reading
    from symid.dynamics.friction_effects import (
        compute_friction_columns as compute_friction_columns,
        get_friction as get_friction,
    )
    from symid.dynamics.lagrange import (
        ExactEnergy as ExactEnergy,
        derive_energy as derive_energy,
        derive_torque_columns as derive_torque_columns,
        evaluate_torque_columns as evaluate_torque_columns,
    )
    from symid.dynamics.nearest_bodies import (
        PSEUDO_INERTIA_FORMS as PSEUDO_INERTIA_FORMS,
        BodyProblem as BodyProblem,
        NearestBodies as NearestBodies,
        build_expected_bodies as build_expected_bodies,
        build_prior as build_prior,
        compute_cost as compute_cost,
        compute_errors as compute_errors,
        compute_standard_parameters as compute_standard_parameters,
        optimise_bodies as optimise_bodies,
    )
    from symid.dynamics.newton_euler import compute_inverse_dynamics as compute_inverse_dynamics
    from symid.dynamics.observable_subspace import build_field as build_field
    from symid.dynamics.payload import (
        PAYLOAD_QUANTITIES as PAYLOAD_QUANTITIES,
        Payload as Payload,
        PayloadQuantity as PayloadQuantity,
        build_base_values as build_base_values,
        estimate_payload as estimate_payload,
    )
    from symid.dynamics.physical_consistency import (
        IdentifiedRobot as IdentifiedRobot,
        StandardSet as StandardSet,
        build_identified_robot as build_identified_robot,
    )
    from symid.dynamics.recursion import (
        ProjectionFrame as ProjectionFrame,
        Recursion as Recursion,
        Wrench as Wrench,
        build_recursion as build_recursion,
        compute_jacobian as compute_jacobian,
        compute_link_poses as compute_link_poses,
        compute_poses as compute_poses,
        fold_matrix as fold_matrix,
        fold_vector as fold_vector,
        rotate_to_link as rotate_to_link,
        transform_wrench as transform_wrench,
    )
    from symid.dynamics.regressors import (
        WEIGHED as WEIGHED,
        compute_body_energy as compute_body_energy,
        compute_torque_columns as compute_torque_columns,
        evaluate_torque_regressor as evaluate_torque_regressor,
        evaluate_weight_columns as evaluate_weight_columns,
    )
    from symid.dynamics.regrouping import (
        OpenReading as OpenReading,
        check_independent as check_independent,
        evaluate_regrouping as evaluate_regrouping,
        express_group as express_group,
        list_coupled_readings as list_coupled_readings,
        list_kindred_readings as list_kindred_readings,
        read_group as read_group,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
