"""Bare hysteresis elements: an input and an output, no robot."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.hysteresis.prandtl_ishlinskii_fit import (
        LEAST_KNEE as LEAST_KNEE,
        LEAST_SLOPE as LEAST_SLOPE,
        SpringWeights as SpringWeights,
        build_elasticity as build_elasticity,
        build_knee_grid as build_knee_grid,
        build_stops as build_stops,
        compute_local_slopes as compute_local_slopes,
        compute_outer as compute_outer,
        compute_ramps as compute_ramps,
        fit_kuhnen as fit_kuhnen,
        hold_knees as hold_knees,
        read_weights as read_weights,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
