"""Many identifications: spread over noise, and the comparisons of the papers."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.study import friction_protocols as friction_protocols
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
        FrictionStudy as FrictionStudy,
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
