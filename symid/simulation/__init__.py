"""The robot under control, with sensors like real ones."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.simulation.experiment import (
        ElasticRun as ElasticRun,
        ExperimentOptions as ExperimentOptions,
        MotorReference as MotorReference,
        build_clean_options as build_clean_options,
        build_noisy_options as build_noisy_options,
        check_sensor_options as check_sensor_options,
        check_stated_values as check_stated_values,
        observe as observe,
        simulate_elastic as simulate_elastic,
        simulate_log as simulate_log,
    )
    from symid.simulation.rigid_plant import (
        RigidPlant as RigidPlant,
        simulate_rigid_plant as simulate_rigid_plant,
    )
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
