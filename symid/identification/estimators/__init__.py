"""From equations to parameters with their standard deviations."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.estimators.consistent import (
        Bodies as Bodies,
        build_bodies as build_bodies,
        solve_consistent as solve_consistent,
    )
    from symid.identification.estimators.estimate import (
        OPEN_SETTINGS as OPEN_SETTINGS,
        PHASES as PHASES,
        SIGNIFICANT as SIGNIFICANT,
        Candidate as Candidate,
        Cause as Cause,
        ConsistencyTest as ConsistencyTest,
        DynamicsRecord as DynamicsRecord,
        Estimate as Estimate,
        Evidence as Evidence,
        FitRecord as FitRecord,
        FittedLaw as FittedLaw,
        JointEvidence as JointEvidence,
        JointRange as JointRange,
        LawSelection as LawSelection,
        LawTrial as LawTrial,
        MotionResidual as MotionResidual,
        Outcome as Outcome,
        ParameterEstimate as ParameterEstimate,
        Residual as Residual,
        ResolvedProcessing as ResolvedProcessing,
        Series as Series,
        SettingsChoice as SettingsChoice,
        Validation as Validation,
        check_bodies as check_bodies,
        check_model as check_model,
        check_robot as check_robot,
        compute_mean_relative as compute_mean_relative,
        describe_other_bodies as describe_other_bodies,
        find_phases as find_phases,
        list_parameters as list_parameters,
        list_shares as list_shares,
        split_uncertain as split_uncertain,
        warn_of_other_bodies as warn_of_other_bodies,
    )
    from symid.identification.estimators.instrumental import (
        InstrumentalSolution as InstrumentalSolution,
        assess_exogeneity as assess_exogeneity,
        fit_instruments as fit_instruments,
    )
    from symid.identification.estimators.least_squares import (
        Influence as Influence,
        RegressionFit as RegressionFit,
        compute_coloured_covariance as compute_coloured_covariance,
        compute_residuals as compute_residuals,
        condense_residuals as condense_residuals,
        estimate_group_weights as estimate_group_weights,
        estimate_period_noise as estimate_period_noise,
        fit_condensed as fit_condensed,
        fit_weighted as fit_weighted,
        fit_wls as fit_wls,
        measure_influence as measure_influence,
    )
    from symid.identification.estimators.linear_estimators import (
        ESTIMATORS as ESTIMATORS,
        build_prior_of_card as build_prior_of_card,
        build_prior_of_estimate as build_prior_of_estimate,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
