"""Measurements as equations that are linear in the parameters."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.regression import condensing as condensing
    from symid.identification.regression.condensing import (
        BandSums as BandSums,
        BlockFit as BlockFit,
        CondensedLogs as CondensedLogs,
        ThinMotion as ThinMotion,
        balance_cutoff as balance_cutoff,
        fit_sums as fit_sums,
        mask_rest as mask_rest,
        mask_trembling as mask_trembling,
        measure_left as measure_left,
        measure_scoring_band as measure_scoring_band,
        scale_products as scale_products,
        solve_products as solve_products,
        sum_motion as sum_motion,
    )
    from symid.identification.regression.equations import (
        ROW_KINDS as ROW_KINDS,
        SCALAR_KINDS as SCALAR_KINDS,
        WINDOW as WINDOW,
        Rows as Rows,
        build_rows as build_rows,
        choose_windows as choose_windows,
        count_pieces as count_pieces,
        evaluate_columns as evaluate_columns,
        evaluate_torques as evaluate_torques,
        integrate_windows as integrate_windows,
        select_rows as select_rows,
        stack_rows as stack_rows,
        warn_of_bad as warn_of_bad,
        warn_of_energy as warn_of_energy,
    )
    from symid.identification.regression.identifiability import (
        JOINT_AT_REST as JOINT_AT_REST,
        Condensed as Condensed,
        Identifiability as Identifiability,
        RankRule as RankRule,
        analyse_condensed as analyse_condensed,
        analyse_identifiability as analyse_identifiability,
        check_identifiable_share as check_identifiable_share,
        compute_spectrum as compute_spectrum,
        compute_square_sums as compute_square_sums,
        condense_rows as condense_rows,
        condense_weighted as condense_weighted,
        count_freedom as count_freedom,
        extend_triangle as extend_triangle,
        hold_resting_joints as hold_resting_joints,
        list_resting_joints as list_resting_joints,
        solve_condensed as solve_condensed,
        solve_scaled as solve_scaled,
        stack_condensed as stack_condensed,
    )
    from symid.identification.regression.preparation import (
        BLOCKS as BLOCKS,
        LONG_KINDS as LONG_KINDS,
        STATES as STATES,
        LoadGain as LoadGain,
        Rotor as Rotor,
        RowBuilder as RowBuilder,
        check_joints as check_joints,
        choose_filters as choose_filters,
        choose_window as choose_window,
        compute_payload_torque as compute_payload_torque,
        compute_rotor_columns as compute_rotor_columns,
        condense_recordings as condense_recordings,
        count_spoilt as count_spoilt,
        fill_load as fill_load,
        fill_loads as fill_loads,
        get_payload as get_payload,
        leave_out_rows as leave_out_rows,
        list_coupled_rotors as list_coupled_rotors,
        list_measured_joints as list_measured_joints,
        mask_fast as mask_fast,
        measure_bands as measure_bands,
        measure_load_gain as measure_load_gain,
        measure_moving_ends as measure_moving_ends,
        outline_motion as outline_motion,
        prepare_rows as prepare_rows,
        prepare_states as prepare_states,
        subtract_loads as subtract_loads,
        warn_of_load_gain as warn_of_load_gain,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
