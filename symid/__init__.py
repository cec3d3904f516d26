"""From a robot description to exact dynamics, fast code and identified parameters.

Example:
    >>> import symid
    >>> robot = symid.load("two_link")
    >>> robot.base.count
    6
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.api.base import BaseSet
    from symid.api.check import RobotCheck
    from symid.api.code import CompiledModel, RobotFunction, TupleFunction, WrittenCode
    from symid.api.comparison import Comparison
    from symid.api.demo import DemoResult, demo
    from symid.api.derivation import Derivation
    from symid.api.doctor import Doctor, doctor
    from symid.api.excitation import ExcitedTrajectory
    from symid.api.export import ExportedFile
    from symid.api.figures import Figures
    from symid.api.fit import ElasticFit, Fit, FrictionFit, RigidFit, load_fit
    from symid.api.identify import Stiffness
    from symid.api.log import Log, build_log, read_log, read_logs
    from symid.api.new import RobotDraft, new_robot
    from symid.api.payload import PayloadResult
    from symid.api.report import FitDiagnosis, FitPage
    from symid.api.result import Result
    from symid.api.robot import RobotModel, list_robots, load
    from symid.api.simulation import Simulation
    from symid.api.studies import FrictionTables, Study, study_friction_tables
    from symid.api.validation import LogValidation
    from symid.errors import (
        EstimateError,
        GenerationError,
        IdentifiabilityError,
        InputError,
        LogError,
        Notice,
        OutputError,
        RobotError,
        SolverError,
        SymidError,
        UsageError,
    )

_MODULES = {
    "api.base": ("BaseSet",),
    "api.check": ("RobotCheck",),
    "api.code": ("CompiledModel", "RobotFunction", "TupleFunction", "WrittenCode"),
    "api.comparison": ("Comparison",),
    "api.demo": ("DemoResult", "demo"),
    "api.derivation": ("Derivation",),
    "api.doctor": ("Doctor", "doctor"),
    "api.excitation": ("ExcitedTrajectory",),
    "api.export": ("ExportedFile",),
    "api.figures": ("Figures",),
    "api.fit": ("ElasticFit", "Fit", "FrictionFit", "RigidFit", "load_fit"),
    "api.identify": ("Stiffness",),
    "api.log": ("Log", "build_log", "read_log", "read_logs"),
    "api.new": ("RobotDraft", "new_robot"),
    "api.payload": ("PayloadResult",),
    "api.report": ("FitDiagnosis", "FitPage"),
    "api.result": ("Result",),
    "api.robot": ("RobotModel", "list_robots", "load"),
    "api.simulation": ("Simulation",),
    "api.studies": ("FrictionTables", "Study", "study_friction_tables"),
    "api.validation": ("LogValidation",),
    "errors": (
        "EstimateError",
        "GenerationError",
        "IdentifiabilityError",
        "InputError",
        "LogError",
        "Notice",
        "OutputError",
        "RobotError",
        "SolverError",
        "SymidError",
        "UsageError",
    ),
}
"""Where names come from when they are first used: importing symid loads nothing else."""
_PLACES = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "BaseSet",
    "Comparison",
    "CompiledModel",
    "DemoResult",
    "Derivation",
    "Doctor",
    "ElasticFit",
    "EstimateError",
    "ExcitedTrajectory",
    "ExportedFile",
    "Figures",
    "Fit",
    "FitDiagnosis",
    "FitPage",
    "FrictionFit",
    "FrictionTables",
    "GenerationError",
    "IdentifiabilityError",
    "InputError",
    "Log",
    "LogError",
    "LogValidation",
    "Notice",
    "OutputError",
    "PayloadResult",
    "Result",
    "RigidFit",
    "RobotCheck",
    "RobotDraft",
    "RobotError",
    "RobotFunction",
    "RobotModel",
    "Simulation",
    "SolverError",
    "Stiffness",
    "Study",
    "SymidError",
    "TupleFunction",
    "UsageError",
    "WrittenCode",
    "__version__",
    "build_log",
    "demo",
    "doctor",
    "list_robots",
    "load",
    "load_fit",
    "new_robot",
    "read_log",
    "read_logs",
    "study_friction_tables",
]

__version__ = "0.1.0"


if not TYPE_CHECKING:  # for type checkers a name that is not imported above is a mistake

    def __getattr__(name: str) -> object:
        if name not in _PLACES:
            message = f"module 'symid' has no attribute {name!r}; it offers {', '.join(__all__)}"
            raise AttributeError(message)
        return getattr(import_module(f"symid.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
