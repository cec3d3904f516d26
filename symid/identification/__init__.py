"""From recordings to parameters with their uncertainty, for rigid and elastic robots."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.identification.compare import (
        ChiSquare as ChiSquare,
        Compared as Compared,
        ComparedValue as ComparedValue,
        EstimateSide as EstimateSide,
        TriedReading as TriedReading,
        build_side as build_side,
        check_comparison_gate as check_comparison_gate,
        check_files as check_files,
        compare_with_estimate as compare_with_estimate,
        compare_with_table as compare_with_table,
        is_table as is_table,
    )
    from symid.identification.export import (
        FileExport as FileExport,
        check_format as check_format,
        locate_source as locate_source,
        refuse_overloads as refuse_overloads,
        write_friction as write_friction,
        write_identified as write_identified,
        write_stated as write_stated,
    )
    from symid.identification.friction_search import (
        needs_search as needs_search,
        read_joint_laws as read_joint_laws,
    )
    from symid.identification.identified import (
        build_bodies as build_bodies,
        build_identified as build_identified,
    )
    from symid.identification.identify import (
        Identification as Identification,
        TaskContext as TaskContext,
        build_elastic_graph as build_elastic_graph,
        identify_robot as identify_robot,
        identify_robot_friction as identify_robot_friction,
        identify_stiffness as identify_stiffness,
        prepare_elastic_methods as prepare_elastic_methods,
    )
    from symid.identification.options import (
        Described as Described,
        IdentifyOptions as IdentifyOptions,
        LawOptions as LawOptions,
    )
    from symid.identification.payload import (
        FlangeFrame as FlangeFrame,
        GivenSide as GivenSide,
        PayloadCommand as PayloadCommand,
        PayloadFinding as PayloadFinding,
        build_payload_command as build_payload_command,
        identify_payload as identify_payload,
        read_payload as read_payload,
    )
    from symid.identification.stored import (
        GivenResult as GivenResult,
        is_kind as is_kind,
        read_dynamics as read_dynamics,
        read_element as read_element,
        read_fit as read_fit,
        read_result as read_result,
        read_stiffness as read_stiffness,
        write_fit as write_fit,
        write_result as write_result,
    )
    from symid.identification.validate import (
        AnyValidation as AnyValidation,
        ElasticValidation as ElasticValidation,
        FrictionValidation as FrictionValidation,
        RigidValidation as RigidValidation,
        TrackingTask as TrackingTask,
        build_tracking_task as build_tracking_task,
        diagnose_fit as diagnose_fit,
        validate_fit as validate_fit,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
