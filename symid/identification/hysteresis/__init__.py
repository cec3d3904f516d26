"""Bare elements: an input and an output, no robot; and the spring of elastic joints while it is fitted."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.hysteresis.families import SAMPLES as SAMPLES, ElementPath as ElementPath
    from symid.identification.hysteresis.fit import (
        ElementParameter as ElementParameter,
        ElementTrace as ElementTrace,
        HysteresisRecord as HysteresisRecord,
        HysteresisTrial as HysteresisTrial,
        choose_spring as choose_spring,
        describe_inversion as describe_inversion,
        find_strokes as find_strokes,
        fit_hysteresis as fit_hysteresis,
        invert_fit as invert_fit,
        measure_return as measure_return,
        predict_element as predict_element,
        validate_element as validate_element,
    )
    from symid.identification.hysteresis.spring_fit import (
        STEP as STEP,
        SpringData as SpringData,
        SpringPlace as SpringPlace,
        SpringWeights as SpringWeights,
        build_elasticity as build_elasticity,
        build_knee_grid as build_knee_grid,
        build_stops as build_stops,
        compute_place_limits as compute_place_limits,
        compute_slips as compute_slips,
        compute_spring_slopes as compute_spring_slopes,
        differentiate_spring as differentiate_spring,
        filter_smooth as filter_smooth,
        fit_spring as fit_spring,
        follow_spring as follow_spring,
        list_spring_numbers as list_spring_numbers,
        move_spring as move_spring,
        read_weights as read_weights,
        refine_spring as refine_spring,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
