"""Recordings: readers, units, checks, filters, alignment, splits."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.logs.alignment import (
        Alignment as Alignment,
        align as align,
        estimate_alignment as estimate_alignment,
        get_encoders as get_encoders,
        keep_significant as keep_significant,
        shift_channel as shift_channel,
        shift_link_channel as shift_link_channel,
        split_blocks as split_blocks,
    )
    from symid.logs.checks import (
        JointSummary as JointSummary,
        check_recording as check_recording,
        find_overloads as find_overloads,
        get_second_encoder_side as get_second_encoder_side,
        summarise_joints as summarise_joints,
    )
    from symid.logs.draft import Draft as Draft, draft_robot as draft_robot
    from symid.logs.faults import choose_times as choose_times, repair_recording as repair_recording
    from symid.logs.files import (
        RawLog as RawLog,
        write_raw_log as write_raw_log,
        write_recording as write_recording,
    )
    from symid.logs.reader import read_raw as read_raw
    from symid.logs.recording import (
        PERCENT as PERCENT,
        STATES as STATES,
        LogPart as LogPart,
        Recording as Recording,
        Signals as Signals,
        States as States,
        cut_ends as cut_ends,
        cut_recording as cut_recording,
        has_states as has_states,
        join_units as join_units,
        read_parts as read_parts,
        refuse_shared as refuse_shared,
        spread_bad as spread_bad,
        take_parts as take_parts,
    )
    from symid.logs.runs import (
        IN_MEMORY_PREFIX as IN_MEMORY_PREFIX,
        Ends as Ends,
        check_distinct as check_distinct,
        check_distinct_samples as check_distinct_samples,
        describe_logs as describe_logs,
        describe_overlap as describe_overlap,
        describe_runs as describe_runs,
        get_run_weights as get_run_weights,
        get_train_unit as get_train_unit,
        is_digest_of_file as is_digest_of_file,
        measure_overlap as measure_overlap,
        read_fit_recordings as read_fit_recordings,
        read_one_log as read_one_log,
        read_recorded_runs as read_recorded_runs,
        read_recordings as read_recordings,
        refuse_known_payloads as refuse_known_payloads,
    )
    from symid.logs.sampling import (
        LogTiming as LogTiming,
        describe_timing as describe_timing,
        measure_timing as measure_timing,
        resample_log as resample_log,
    )
    from symid.logs.signals import (
        SignalParts as SignalParts,
        choose_processing as choose_processing,
        choose_thinning as choose_thinning,
        compute_noise_bandwidth as compute_noise_bandwidth,
        decimate as decimate,
        decimate_blocks as decimate_blocks,
        describe_uneven as describe_uneven,
        differentiate as differentiate,
        differentiate_smooth as differentiate_smooth,
        estimate_density as estimate_density,
        list_live as list_live,
        low_pass as low_pass,
        mask_decimated as mask_decimated,
        mask_filtered as mask_filtered,
        mask_states as mask_states,
        mask_touched as mask_touched,
        prepare_signals as prepare_signals,
    )
    from symid.logs.tables import read_csv as read_csv
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
