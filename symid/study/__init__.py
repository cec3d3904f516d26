"""Many identifications: spread over noise, and the comparisons of the papers."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.study import (
        elastic_methods as elastic_methods,
        foreign_truths as foreign_truths,
        friction_protocols as friction_protocols,
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
