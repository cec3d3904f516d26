"""The front door: one object for a robot, a log and a result, with methods named as the verbs.

`symid` itself offers what users call; here stands what only verbs and fleets use.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.api import hysteresis as hysteresis
    from symid.api.dynamics import BaseForm as BaseForm
    from symid.api.identification import load_other as load_other
    from symid.api.log import pair_parts as pair_parts
    from symid.api.result import PagedResult as PagedResult
    from symid.api.robot_files import export_fit as export_fit
    from symid.api.validation import compare_fit as compare_fit
    from symid.codegen import BACKENDS as BACKENDS
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
