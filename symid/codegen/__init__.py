"""The catalogue of functions, generated C, Python and CasADi, and the libraries built from them."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.codegen.c_library import generate_friction_state as generate_friction_state
    from symid.codegen.cache import (
        keep_dynamics as keep_dynamics,
        locate_cache_folder as locate_cache_folder,
        prepare_library as prepare_library,
    )
    from symid.codegen.casadi_functions import (
        build_casadi_function as build_casadi_function,
        build_functions as build_functions,
    )
    from symid.codegen.compiled_models import (
        RIGID_FUNCTIONS as RIGID_FUNCTIONS,
        CompiledPlant as CompiledPlant,
        PlantExperiment as PlantExperiment,
        PlantLog as PlantLog,
        PlantRobot as PlantRobot,
        RigidExperiment as RigidExperiment,
        RigidLog as RigidLog,
        build_compiled_function as build_compiled_function,
        has_addresses as has_addresses,
        load_plant_code as load_plant_code,
        run_compiled_branch as run_compiled_branch,
    )
    from symid.codegen.compiler import locate_compiler as locate_compiler
    from symid.codegen.element_code import (
        ElementCode as ElementCode,
        generate_element as generate_element,
        generate_springs as generate_springs,
    )
    from symid.codegen.functions import (
        LIMITED as LIMITED,
        FunctionSpec as FunctionSpec,
        JointCard as JointCard,
        ModelCard as ModelCard,
        ParameterCard as ParameterCard,
        build_model_card as build_model_card,
        build_spring_vector as build_spring_vector,
        compute_model_signature as compute_model_signature,
        list_robot_specs as list_robot_specs,
        list_spring_parameters as list_spring_parameters,
    )
    from symid.codegen.generation import (
        GeneratedFolder as GeneratedFolder,
        generate_folder as generate_folder,
    )
    from symid.codegen.library import Call as Call, Library as Library, choose_call_path as choose_call_path
    from symid.codegen.python_targets import write_javascript_function as write_javascript_function
    from symid.codegen.routes import (
        RouteCount as RouteCount,
        choose_route as choose_route,
        count_route_operations as count_route_operations,
    )
    from symid.codegen.source_text import (
        BACKENDS as BACKENDS,
        build_library_prefix as build_library_prefix,
        clean_text as clean_text,
    )
    from symid.codegen.symbolic import (
        SymbolicFunction as SymbolicFunction,
        derive_symbolic as derive_symbolic,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
