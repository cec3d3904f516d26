"""Residuals and uncertainty of a fit, warnings about it, and checks of a log before a fit."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.diagnostics import uncertainty as uncertainty
    from symid.identification.diagnostics.causes import (
        FollowedLogs as FollowedLogs,
        estimate_gravity as estimate_gravity,
        evaluate_motion as evaluate_motion,
        find_causes as find_causes,
        fit_motion as fit_motion,
        list_mistakes as list_mistakes,
        list_terms as list_terms,
        measure_shares as measure_shares,
        shift_torques as shift_torques,
        suspect_gravity as suspect_gravity,
        suspect_logs as suspect_logs,
    )
    from symid.identification.diagnostics.fit_warnings import (
        build_warning as build_warning,
        describe_proportion as describe_proportion,
        evaluate_inertia_columns as evaluate_inertia_columns,
        sum_block_scores as sum_block_scores,
        warn_of_correlated_residuals as warn_of_correlated_residuals,
        warn_of_mass_matrix as warn_of_mass_matrix,
        warn_of_moving_ends as warn_of_moving_ends,
        warn_of_poorly_identifiable as warn_of_poorly_identifiable,
        warn_of_processing as warn_of_processing,
    )
    from symid.identification.diagnostics.residual_structure import (
        OTHER_VALUES as OTHER_VALUES,
        BandResidual as BandResidual,
        JointProfiles as JointProfiles,
        ResidualFinding as ResidualFinding,
        analyse_residuals as analyse_residuals,
        compute_band_residual as compute_band_residual,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
