"""From a robot description to exact dynamics, fast code and identified parameters.

Example:
    >>> import symid
    >>> robot = symid.load("two_link")
    >>> robot.base.count
    6
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from symid import fleet as fleet
    from symid.api import hysteresis as hysteresis
    from symid.api.code import (
        CompiledModel as CompiledModel,
        RobotFunction as RobotFunction,
        TupleFunction as TupleFunction,
        WrittenCode as WrittenCode,
    )
    from symid.api.dynamics import (
        BaseSet as BaseSet,
        Derivation as Derivation,
        MarkedSheet as MarkedSheet,
        WrittenLesson as WrittenLesson,
    )
    from symid.api.experiment import (
        ExcitedTrajectory as ExcitedTrajectory,
        FrictionTables as FrictionTables,
        Simulation as Simulation,
        Study as Study,
        study_foreign as study_foreign,
        study_friction_tables as study_friction_tables,
    )
    from symid.api.first_steps import (
        DemoResult as DemoResult,
        Doctor as Doctor,
        demo as demo,
        doctor as doctor,
    )
    from symid.api.fit import (
        ElasticFit as ElasticFit,
        Fit as Fit,
        FrictionFit as FrictionFit,
        RigidFit as RigidFit,
    )
    from symid.api.identification import (
        OneShotProblem as OneShotProblem,
        OneShotSolution as OneShotSolution,
        PayloadResult as PayloadResult,
        Stiffness as Stiffness,
        load_payload as load_payload,
        load_stiffness as load_stiffness,
    )
    from symid.api.log import (
        Log as Log,
        RobotCheck as RobotCheck,
        build_log as build_log,
        read_log as read_log,
        read_logs as read_logs,
    )
    from symid.api.result import Figures as Figures, Result as Result
    from symid.api.robot import (
        RobotModel as RobotModel,
        list_robots as list_robots,
        load as load,
        load_fit as load_fit,
    )
    from symid.api.robot_files import (
        ExportedFile as ExportedFile,
        RobotDraft as RobotDraft,
        new_robot as new_robot,
    )
    from symid.api.validation import (
        Comparison as Comparison,
        FitDiagnosis as FitDiagnosis,
        FitPage as FitPage,
        LogValidation as LogValidation,
    )
    from symid.errors import (
        EstimateError as EstimateError,
        GenerationError as GenerationError,
        IdentifiabilityError as IdentifiabilityError,
        InputError as InputError,
        LogError as LogError,
        Notice as Notice,
        OutputError as OutputError,
        RobotError as RobotError,
        SolverError as SolverError,
        SymidError as SymidError,
        UsageError as UsageError,
    )
    from symid.identification import IdentifyOptions as IdentifyOptions, LawOptions as LawOptions
    from symid.options import (
        DraftOptions as DraftOptions,
        ExciteOptions as ExciteOptions,
        SimulateOptions as SimulateOptions,
    )
else:
    from symid.lazy import load_names as load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
