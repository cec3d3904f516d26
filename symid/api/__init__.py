"""The front door: one object for a robot, a log and a result, with methods named as the verbs."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.api import hysteresis as hysteresis
    from symid.api.code import (
        CompiledModel as CompiledModel,
        RobotFunction as RobotFunction,
        TupleFunction as TupleFunction,
        WrittenCode as WrittenCode,
    )
    from symid.api.dynamics import (
        BaseForm as BaseForm,
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
        load_other as load_other,
        load_payload as load_payload,
        load_stiffness as load_stiffness,
    )
    from symid.api.log import (
        Log as Log,
        RobotCheck as RobotCheck,
        build_log as build_log,
        pair_parts as pair_parts,
        read_log as read_log,
        read_logs as read_logs,
    )
    from symid.api.result import Figures as Figures, PagedResult as PagedResult, Result as Result
    from symid.api.robot import (
        RobotModel as RobotModel,
        list_robots as list_robots,
        load as load,
        load_fit as load_fit,
    )
    from symid.api.robot_files import (
        ExportedFile as ExportedFile,
        RobotDraft as RobotDraft,
        export_fit as export_fit,
        new_robot as new_robot,
    )
    from symid.api.validation import (
        Comparison as Comparison,
        FitDiagnosis as FitDiagnosis,
        FitPage as FitPage,
        LogValidation as LogValidation,
        compare_fit as compare_fit,
    )
    from symid.codegen import BACKENDS as BACKENDS
    from symid.identification import IdentifyOptions as IdentifyOptions, LawOptions as LawOptions
    from symid.options import (
        DraftOptions as DraftOptions,
        ExciteOptions as ExciteOptions,
        ExportOptions as ExportOptions,
        FleetOptions as FleetOptions,
        GenerateOptions as GenerateOptions,
        HysteresisOptions as HysteresisOptions,
        PayloadOptions as PayloadOptions,
        SimulateOptions as SimulateOptions,
        list_options as list_options,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
