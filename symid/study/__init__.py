"""Many identifications: spread over noise, and the comparisons of the papers."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.study.elastic_methods import (
        DatasetStudy as DatasetStudy,
        ElasticStudy as ElasticStudy,
        ManyJointsResult as ManyJointsResult,
        SensorCondition as SensorCondition,
        TrackingStudy as TrackingStudy,
        compute_hysteresis_errors as compute_hysteresis_errors,
        compute_parameter_error as compute_parameter_error,
        get_true_parameters as get_true_parameters,
        observe_runs as observe_runs,
        simulate_runs as simulate_runs,
        study_elastic as study_elastic,
        study_many_joints as study_many_joints,
        study_tracking as study_tracking,
    )
    from symid.study.foreign_truths import (
        TRUTHS as TRUTHS,
        ForeignRun as ForeignRun,
        ForeignStudy as ForeignStudy,
        study_foreign as study_foreign,
        try_foreign as try_foreign,
    )
    from symid.study.friction_protocols import (
        AGREEMENT as AGREEMENT,
        CALIBRATION as CALIBRATION,
        LAWS as LAWS,
        NEARNESS as NEARNESS,
        NOT_IDENTIFIABLE as NOT_IDENTIFIABLE,
        PEAK as PEAK,
        RECOVERY_PEAKS as RECOVERY_PEAKS,
        SWEEPS as SWEEPS,
        TABLE_1 as TABLE_1,
        TABLE_3 as TABLE_3,
        TABLE_4 as TABLE_4,
        AgreementStudy as AgreementStudy,
        EstimatorComparison as EstimatorComparison,
        FrictionCheck as FrictionCheck,
        FrictionStudy as FrictionStudy,
        GainStudy as GainStudy,
        RecoveredParameter as RecoveredParameter,
        Recovery as Recovery,
        SearchRace as SearchRace,
        build_gain_scene as build_gain_scene,
        build_recovery_scene as build_recovery_scene,
        build_sweep_scene as build_sweep_scene,
        draw_samples as draw_samples,
        study_friction as study_friction,
    )
    from symid.study.rigid_methods import (
        CutoffStudy as CutoffStudy,
        PrecisionStudy as PrecisionStudy,
        study_cutoff as study_cutoff,
        study_precision as study_precision,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
