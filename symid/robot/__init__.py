"""What a robot is, and how it is written: its description, readers and writers."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.robot.description import (
        DEFAULT_GRAVITY as DEFAULT_GRAVITY,
        QUANTITIES as QUANTITIES,
        UNKNOWN as UNKNOWN,
        Controller as Controller,
        Coupling as Coupling,
        Decimation as Decimation,
        FixedBody as FixedBody,
        Joint as Joint,
        JointKind as JointKind,
        Limits as Limits,
        LogMap as LogMap,
        LogQuantity as LogQuantity,
        Mimic as Mimic,
        Processing as Processing,
        Robot as Robot,
        SourceFile as SourceFile,
        Spring as Spring,
        SymbolicInertia as SymbolicInertia,
        mount_robot as mount_robot,
        refuse_passive_joints as refuse_passive_joints,
    )
    from symid.robot.geometry import (
        IDENTITY as IDENTITY,
        ONE as ONE,
        ZERO as ZERO,
        Exact as Exact,
        Placement as Placement,
        Surd as Surd,
        compose_placements as compose_placements,
        invert_placement as invert_placement,
    )
    from symid.robot.inertia import (
        build_pseudo_inertias as build_pseudo_inertias,
        explain_impossible_inertia as explain_impossible_inertia,
        is_same_body as is_same_body,
        move_by_placement as move_by_placement,
        move_parameters as move_parameters,
        to_matrix as to_matrix,
    )
    from symid.robot.loading import (
        Vector as Vector,
        complete_robot as complete_robot,
        is_mjcf as is_mjcf,
        is_xml as is_xml,
        list_robots as list_robots,
        load_robot as load_robot,
        locate_robot_file as locate_robot_file,
        name_for_commands as name_for_commands,
        override_robot as override_robot,
        override_settings as override_settings,
        state_mounting as state_mounting,
    )
    from symid.robot.mjcf_reader import parse_xml_robot as parse_xml_robot, read_xml_robot as read_xml_robot
    from symid.robot.parameter_values import (
        RobotValues as RobotValues,
        TableColumns as TableColumns,
        ValueRow as ValueRow,
        ValueVector as ValueVector,
        build_json_values as build_json_values,
        read_value_table as read_value_table,
        write_c_values as write_c_values,
    )
    from symid.robot.simulator_writers import (
        list_mjcf_omissions as list_mjcf_omissions,
        list_urdf_omissions as list_urdf_omissions,
        list_usd_omissions as list_usd_omissions,
        write_mjcf as write_mjcf,
        write_urdf as write_urdf,
        write_usd as write_usd,
    )
    from symid.robot.toml_reader import (
        parse_robot as parse_robot,
        read_body as read_body,
        read_dh_table as read_dh_table,
        read_robot as read_robot,
    )
    from symid.robot.toml_settings import (
        JOINT_DIMENSIONS as JOINT_DIMENSIONS,
        TransmissionMatrix as TransmissionMatrix,
        compute_condition as compute_condition,
        compute_current_factor as compute_current_factor,
        describe_settings as describe_settings,
        list_controller as list_controller,
        read_log as read_log,
        read_offset as read_offset,
        read_processing as read_processing,
    )
    from symid.robot.toml_values import (
        NOT_NEGATIVE as NOT_NEGATIVE,
        POSITIVE as POSITIVE,
        Places as Places,
        Section as Section,
        parse_toml as parse_toml,
        read_text_file as read_text_file,
        sort_notices as sort_notices,
        suggest_names as suggest_names,
        to_decimal as to_decimal,
    )
    from symid.robot.toml_writer import (
        move_source as move_source,
        place_elasticity as place_elasticity,
        write_robot as write_robot,
    )
    from symid.robot.urdf_reader import DEFAULT_SNAP as DEFAULT_SNAP
    from symid.robot.urdf_xml import read_urdf_text as read_urdf_text
    from symid.robot.xml_rewriters import rewrite_mjcf as rewrite_mjcf, rewrite_urdf as rewrite_urdf
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
