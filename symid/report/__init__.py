"""A result as text, JSON, tables, figures and pages."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.report import (
        drawings as drawings,
        result_pages as result_pages,
        study_text as study_text,
        texts as texts,
    )
    from symid.report.blocks import (
        Block as Block,
        Drawing as Drawing,
        Table as Table,
        shorten_text as shorten_text,
        write_html as write_html,
        write_svg as write_svg,
        write_text as write_text,
    )
    from symid.report.elastic_page import build_elastic_page as build_elastic_page, draw_loops as draw_loops
    from symid.report.figures import Line as Line, build_line_figure as build_line_figure
    from symid.report.identification_page import (
        WrittenPage as WrittenPage,
        describe_essential as describe_essential,
        describe_rank as describe_rank,
        draw_fit as draw_fit,
        draw_prediction as draw_prediction,
        judge_fit as judge_fit,
        write_fit_page as write_fit_page,
    )
    from symid.report.pages import (
        Page as Page,
        describe_origin as describe_origin,
        write_figures as write_figures,
        write_page as write_page,
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
