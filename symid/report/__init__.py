"""A result as text, JSON, tables, figures and pages."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.report.blocks import (
        Block as Block,
        Drawing as Drawing,
        Table as Table,
        write_html as write_html,
        write_svg as write_svg,
        write_text as write_text,
    )
    from symid.report.drawings import (
        draw_excitation as draw_excitation,
        draw_into as draw_into,
        draw_log as draw_log,
        draw_motion as draw_motion,
        draw_robot as draw_robot,
    )
    from symid.report.elastic_page import build_elastic_page as build_elastic_page
    from symid.report.figures import Line as Line, build_line_figure as build_line_figure
    from symid.report.fit_text import (
        describe_alignment as describe_alignment,
        describe_elastic as describe_elastic,
        describe_estimate as describe_estimate,
        describe_friction as describe_friction,
        describe_stiffness as describe_stiffness,
        show_elastic as show_elastic,
        show_elastic_parameters as show_elastic_parameters,
        show_estimate as show_estimate,
        show_friction as show_friction,
        show_springs as show_springs,
        show_stiffness as show_stiffness,
    )
    from symid.report.identification_page import (
        WrittenPage as WrittenPage,
        draw_fit as draw_fit,
        judge_fit as judge_fit,
        write_fit_page as write_fit_page,
    )
    from symid.report.pages import (
        Page as Page,
        describe_origin as describe_origin,
        write_figures as write_figures,
        write_page as write_page,
    )
    from symid.report.result_pages import (
        describe_element as describe_element,
        draw_check as draw_check,
        draw_element as draw_element,
        judge_element as judge_element,
        judge_element_trial as judge_element_trial,
        show_element as show_element,
        write_check_page as write_check_page,
        write_comparison_page as write_comparison_page,
        write_element_page as write_element_page,
        write_excitation_page as write_excitation_page,
        write_payload_page as write_payload_page,
        write_stiffness_page as write_stiffness_page,
    )
    from symid.report.robot_text import (
        describe_base as describe_base,
        describe_code as describe_code,
        describe_derivation as describe_derivation,
        describe_draft as describe_draft,
        describe_excitation as describe_excitation,
        describe_export as describe_export,
        describe_log as describe_log,
        describe_payload as describe_payload,
        describe_robot_check as describe_robot_check,
        list_remarks as list_remarks,
        show_base as show_base,
        show_code as show_code,
        show_derivation as show_derivation,
        show_draft as show_draft,
        show_excitation as show_excitation,
        show_export as show_export,
        show_joints as show_joints,
        show_payload as show_payload,
        show_robot_check as show_robot_check,
        summarise_code as summarise_code,
        summarise_draft as summarise_draft,
        summarise_robot as summarise_robot,
        tabulate_base as tabulate_base,
        warn_payload as warn_payload,
        write_base_latex as write_base_latex,
        write_derivation_html as write_derivation_html,
        write_derivation_latex as write_derivation_latex,
    )
    from symid.report.study_text import (
        build_friction_study_page as build_friction_study_page,
        show_cutoff as show_cutoff,
        show_elastic_study as show_elastic_study,
        show_foreign as show_foreign,
        show_friction_tables as show_friction_tables,
        show_many_joints as show_many_joints,
        show_precision as show_precision,
        show_tracking as show_tracking,
    )
    from symid.report.validation_text import (
        describe_comparison as describe_comparison,
        describe_diagnosis as describe_diagnosis,
        describe_trial as describe_trial,
        draw_trial as draw_trial,
        show_comparison as show_comparison,
        show_diagnosis as show_diagnosis,
        show_trial as show_trial,
        warn_comparison as warn_comparison,
    )
    from symid.report.verdict import (
        AnyEstimate as AnyEstimate,
        FitVerdict as FitVerdict,
        judge_trial as judge_trial,
        list_verdict_notices as list_verdict_notices,
        show_verdict as show_verdict,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
