"""The judge: two statistics and one table of numbers, by which all choices, verdicts and causes are made."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.judge import numerics as numerics
    from symid.identification.judge.policy import POLICY as POLICY
    from symid.identification.judge.statistics import (
        Agreement as Agreement,
        Difference as Difference,
        Gain as Gain,
        adjust_chances as adjust_chances,
        agree as agree,
        agree_in_value as agree_in_value,
        compare as compare,
        compute_chance as compute_chance,
        compute_changes as compute_changes,
        compute_variance as compute_variance,
        measure_inferiority as measure_inferiority,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
