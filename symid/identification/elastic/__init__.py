"""Identification of robots with elastic joints: dynamics, friction and hysteresis from plain tracking."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.elastic import nlp as nlp
    from symid.identification.elastic.elimination import (
        compute_speeds as compute_speeds,
        fit_elimination as fit_elimination,
    )
    from symid.identification.elastic.estimate import (
        ElasticEstimate as ElasticEstimate,
        ElasticEvidence as ElasticEvidence,
        MethodFit as MethodFit,
        SpringEstimate as SpringEstimate,
        build_method_fit as build_method_fit,
    )
    from symid.identification.elastic.identify import (
        build_one_shot as build_one_shot,
        prepare_methods as prepare_methods,
    )
    from symid.identification.elastic.methods import (
        AUTOMATIC_METHODS as AUTOMATIC_METHODS,
        Maker as Maker,
        build_elastic_equations as build_elastic_equations,
        choose_fit as choose_fit,
        fit_method as fit_method,
    )
    from symid.identification.elastic.options import (
        METHODS as METHODS,
        ElasticOptions as ElasticOptions,
        NlpOptions as NlpOptions,
    )
    from symid.identification.elastic.regression import (
        MOVES as MOVES,
        DriveEffect as DriveEffect,
        ElasticProblem as ElasticProblem,
        ElasticSignals as ElasticSignals,
        build_elastic_problem as build_elastic_problem,
        build_equations as build_equations,
        build_filtered_rows as build_filtered_rows,
        build_spring_data as build_spring_data,
        filter_derivative as filter_derivative,
        get_encoder_positions as get_encoder_positions,
        join_rigid_joints as join_rigid_joints,
        prepare_elastic_signals as prepare_elastic_signals,
        solve_with_signs as solve_with_signs,
    )
    from symid.identification.elastic.routing import (
        build_motor_recording as build_motor_recording,
        build_rigid_estimate as build_rigid_estimate,
        build_rigid_variant as build_rigid_variant,
        check_settings as check_settings,
        choose_route as choose_route,
        cut_logs as cut_logs,
        get_stated_cutoff as get_stated_cutoff,
        has_both_encoders as has_both_encoders,
        list_unused_settings as list_unused_settings,
        refuse_elasticity as refuse_elasticity,
        warn_of_rotors as warn_of_rotors,
    )
    from symid.identification.elastic.stiffness import (
        JointStiffness as JointStiffness,
        StiffnessEstimate as StiffnessEstimate,
        estimate_stiffness as estimate_stiffness,
        prepare_aligned as prepare_aligned,
    )
    from symid.identification.elastic.validation import (
        RIGID as RIGID,
        ElasticTrial as ElasticTrial,
        JointTrial as JointTrial,
        TrackingRun as TrackingRun,
        evaluate_elastic as evaluate_elastic,
        simulate_tracking as simulate_tracking,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
