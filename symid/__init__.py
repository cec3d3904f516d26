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
    from symid.api import (
        BaseSet as BaseSet,
        Comparison as Comparison,
        CompiledModel as CompiledModel,
        DemoResult as DemoResult,
        Derivation as Derivation,
        Doctor as Doctor,
        DraftOptions as DraftOptions,
        ElasticFit as ElasticFit,
        ExcitedTrajectory as ExcitedTrajectory,
        ExciteOptions as ExciteOptions,
        ExportedFile as ExportedFile,
        Figures as Figures,
        Fit as Fit,
        FitDiagnosis as FitDiagnosis,
        FitPage as FitPage,
        FrictionFit as FrictionFit,
        FrictionTables as FrictionTables,
        IdentifyOptions as IdentifyOptions,
        LawOptions as LawOptions,
        Log as Log,
        LogValidation as LogValidation,
        MarkedSheet as MarkedSheet,
        OneShotProblem as OneShotProblem,
        OneShotSolution as OneShotSolution,
        PayloadResult as PayloadResult,
        Result as Result,
        RigidFit as RigidFit,
        RobotCheck as RobotCheck,
        RobotDraft as RobotDraft,
        RobotFunction as RobotFunction,
        RobotModel as RobotModel,
        SimulateOptions as SimulateOptions,
        Simulation as Simulation,
        Stiffness as Stiffness,
        Study as Study,
        TupleFunction as TupleFunction,
        WrittenCode as WrittenCode,
        WrittenLesson as WrittenLesson,
        build_log as build_log,
        demo as demo,
        doctor as doctor,
        hysteresis as hysteresis,
        list_robots as list_robots,
        load as load,
        load_fit as load_fit,
        load_payload as load_payload,
        load_stiffness as load_stiffness,
        new_robot as new_robot,
        read_log as read_log,
        read_logs as read_logs,
        study_foreign as study_foreign,
        study_friction_tables as study_friction_tables,
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
else:
    from symid.lazy import load_names as load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
