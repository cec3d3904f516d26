"""Trajectories that make parameters identifiable."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.excitation.optimise import (
        OptimisedExcitation as OptimisedExcitation,
        optimise_excitation as optimise_excitation,
    )
    from symid.excitation.problem import Margin as Margin
    from symid.excitation.trajectories import (
        FourierOptions as FourierOptions,
        ReferenceMotion as ReferenceMotion,
        SampledMotion as SampledMotion,
        Trajectory as Trajectory,
        build_motion as build_motion,
        build_random_fourier as build_random_fourier,
        build_ta as build_ta,
        build_tb as build_tb,
        build_tc as build_tc,
        is_trajectory as is_trajectory,
        read_trajectory as read_trajectory,
        scale_trajectory as scale_trajectory,
        write_trajectory as write_trajectory,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
