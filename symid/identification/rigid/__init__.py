"""Identification of robots with rigid joints."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.rigid.closed_loop import (
        check_closed_loop as check_closed_loop,
        identify_closed_loop as identify_closed_loop,
    )
    from symid.identification.rigid.fit import identify_parameters as identify_parameters
    from symid.identification.rigid.friction_choice import (
        CANDIDATES as CANDIDATES,
        PLAIN as PLAIN,
        FrictionChoice as FrictionChoice,
        Search as Search,
        Trial as Trial,
        Wish as Wish,
        choose_laws as choose_laws,
        choose_plainest as choose_plainest,
        choose_trial as choose_trial,
        compare_friction as compare_friction,
        describe_choice as describe_choice,
        search_laws as search_laws,
    )
    from symid.identification.rigid.friction_tables import (
        JointTable as JointTable,
        Wanted as Wanted,
        list_shape_nodes as list_shape_nodes,
        tabulate_rows as tabulate_rows,
    )
    from symid.identification.rigid.log_check import (
        CheckedLog as CheckedLog,
        LogCheck as LogCheck,
        LogExcitation as LogExcitation,
        LogsCheck as LogsCheck,
        check_robot_logs as check_robot_logs,
        summarise_log as summarise_log,
    )
    from symid.identification.rigid.plan import (
        PRIOR_OF_ROBOT as PRIOR_OF_ROBOT,
        SIMULATING as SIMULATING,
        FitPlan as FitPlan,
        build_estimator_options as build_estimator_options,
        check_estimator as check_estimator,
        check_rigid_options as check_rigid_options,
        plan_fit as plan_fit,
    )
    from symid.identification.rigid.scale import (
        JointScale as JointScale,
        compare_fit_scales as compare_fit_scales,
        describe_scales as describe_scales,
        keep_overloads as keep_overloads,
    )
    from symid.identification.rigid.validation import (
        Diagnosis as Diagnosis,
        diagnose_estimate as diagnose_estimate,
        get_fit_overlap as get_fit_overlap,
        get_usable_window as get_usable_window,
        resolve_processing as resolve_processing,
        restore_robot as restore_robot,
        validate_estimate as validate_estimate,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
