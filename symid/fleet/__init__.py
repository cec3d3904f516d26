"""Many identifications, unattended: fleets of robots, night after night."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symid.fleet.jobs import FleetJob as FleetJob, read_study as read_study
    from symid.fleet.running import FleetRow as FleetRow, FleetValue as FleetValue
    from symid.fleet.view import Fleet as Fleet, RobotChange as RobotChange, load as load, run as run
else:
    from symid.lazy import load_names

    __getattr__, __dir__, __all__ = load_names(__name__, __file__)
