"""Residuals and uncertainty of a fit, warnings about it, and checks of a log before a fit."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.diagnostics import uncertainty as uncertainty
    from symid.identification.diagnostics.causes import (
        build_quick_logs as build_quick_logs,
        find_cause as find_cause,
        fit_quick as fit_quick,
        list_proportions as list_proportions,
    )
    from symid.identification.diagnostics.fit_warnings import (
        build_warning as build_warning,
        evaluate_inertia_columns as evaluate_inertia_columns,
        sum_block_scores as sum_block_scores,
        warn_of_correlated_residuals as warn_of_correlated_residuals,
        warn_of_mass_matrix as warn_of_mass_matrix,
        warn_of_moving_ends as warn_of_moving_ends,
        warn_of_poorly_identifiable as warn_of_poorly_identifiable,
        warn_of_processing as warn_of_processing,
    )
    from symid.identification.diagnostics.log_check import (
        CheckedLog as CheckedLog,
        LogCheck as LogCheck,
        LogExcitation as LogExcitation,
        LogsCheck as LogsCheck,
        check_robot_logs as check_robot_logs,
        describe_proportion as describe_proportion,
        summarise_log as summarise_log,
    )
    from symid.identification.diagnostics.residual_structure import (
        FAMILIES as FAMILIES,
        OTHER_VALUES as OTHER_VALUES,
        BandResidual as BandResidual,
        JointMotion as JointMotion,
        JointProfiles as JointProfiles,
        ResidualFinding as ResidualFinding,
        analyse_structure as analyse_structure,
        compute_band_residual as compute_band_residual,
        compute_profiles as compute_profiles,
        pick_motion as pick_motion,
        predict_torques as predict_torques,
    )
    from symid.identification.diagnostics.stretches import (
        ENDS as ENDS,
        PART as PART,
        STRETCHES as STRETCHES,
        Stretches as Stretches,
        choose_held_out as choose_held_out,
        compute_jackknife as compute_jackknife,
        count_stretches as count_stretches,
        determine_each_other as determine_each_other,
        fit_stretches as fit_stretches,
        mask_inner as mask_inner,
        measure_behind as measure_behind,
        measure_gain as measure_gain,
        measure_scoring_band as measure_scoring_band,
        smooth_rows as smooth_rows,
        solve_sums as solve_sums,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
