"""Further results of identification: the stiffness of joints, and the payload of a robot.

`Stiffness`: joint by joint, with delay and offsets of encoders; `PayloadResult`: mass, centre of mass and
inertia, from fits or logs with the payload and without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, final

from symid import report
from symid.api.log import Log, Logged, LogLike
from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.arrays import FloatArray
    from symid.dynamics import Payload, PayloadQuantity
    from symid.identification import GivenResult, GivenSide, PayloadFinding
    from symid.identification.elastic import JointStiffness, StiffnessEstimate
    from symid.report import Block


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Stiffness(Result):
    """The stiffness of every joint with 95 % intervals, and delay and offsets of the encoders.

    Attributes:
        estimate: the full result.
        notices: warnings and notes on the robot, its logs and the result.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> found = robot.identify_stiffness(robot.simulate(duration=6.0, seed=1).log)
        >>> sorted(found.joints)
        ['elbow', 'shoulder']
    """

    estimate: "StiffnessEstimate"
    notices: tuple[Notice, ...] = ()

    @property
    def joints(self) -> "dict[str, JointStiffness]":
        """Return the result of every joint by its name."""
        return {entry.joint: entry for entry in self.estimate.joints}

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the result to `path` as JSON and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        from symid.environment import write_file
        from symid.serialization import write_json

        file = Path(fspath(path))
        return write_file(file, write_json({**self.to_dict(), "file": file}))

    def summarise(self) -> str:
        """Return the joints with a stiffness."""
        names = [name for name, entry in self.joints.items() if entry.stiffness is not None]
        return f"{self.estimate.robot}: stiffness of {', '.join(names) or 'no joint'}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return delay, offsets and stiffness."""
        return report.show_stiffness(self.estimate)

    def to_dict(self) -> dict[str, object]:
        """Return delay, offsets and stiffness in plain types."""
        return report.describe_stiffness(self.estimate)


PayloadRows = Literal["torque", "momentum"]
PayloadEstimator = Literal["ols", "wls"]
PayloadSide: TypeAlias = "GivenResult | LogLike | Sequence[LogLike]"
"""One side: a fit or its file, or logs."""


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PayloadResult(Result):
    """The payload of a robot, in the link frame of the robot file; a physically consistent body.

    Attributes:
        product: the payload with standard deviations, and the quantities that are not identifiable.

    Example:
        >>> import symid
        >>> from pathlib import Path
        >>> robot = symid.load("two_link")
        >>> heavy = robot.path.read_text().replace("mass = 1.9", "mass = 2.9")
        >>> Path("carrying.toml").write_text(heavy) == len(heavy)
        True
        >>> loaded = symid.load("carrying.toml").simulate(duration=4.0, seed=2).log
        >>> found = robot.payload(loaded, robot.simulate(duration=4.0, seed=1).log)
        >>> found.joint, round(found["mass"].value, 1)
        ('elbow', 1.0)
    """

    product: "PayloadFinding"

    @property
    def payload(self) -> "Payload":
        """Return the full result."""
        return self.product.payload

    @property
    def joint(self) -> str:
        """Return the joint whose link carries it."""
        return self.payload.joint

    def __getitem__(self, name: str) -> "PayloadQuantity":
        """Return mass, cx, cy, cz, Jxx, Jxy, Jxz, Jyy, Jyz or Jzz, with deviation or reason."""
        return {entry.name: entry for entry in self.payload.quantities}[name]

    @property
    def mass(self) -> float:
        """Return the mass in kg."""
        return self._list_values("mass")[0]

    @property
    def com(self) -> "FloatArray":
        """Return the centre of mass in m: (3,), NaN where it is not identifiable."""
        import numpy as np

        return np.array(self._list_values("cx", "cy", "cz"))

    @property
    def inertia(self) -> "FloatArray":
        """Return the inertia about the centre of mass in kg m^2: (3, 3), NaN where it is not identifiable."""
        import numpy as np

        xx, xy, xz, yy, yz, zz = self._list_values("Jxx", "Jxy", "Jxz", "Jyy", "Jyz", "Jzz")
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def _list_values(self, *names: str) -> list[float]:
        return [
            float("nan") if self[name].value is None else float(self[name].value or 0.0) for name in names
        ]

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings: quantities that are not identifiable, other changes between both sides."""
        return tuple(dict.fromkeys((*self.product.notices, *report.warn_payload(self.payload))))

    def summarise(self) -> str:
        """Return the mass and the link."""
        return f"{self.product.robot.name}: {self.mass:.4g} kg on the link of joint {self.joint!r}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return the tables of identified and of refused quantities, with the reasons."""
        return report.show_payload(self.product.robot, self.payload)

    def to_dict(self) -> dict[str, object]:
        """Return quantities, deviations and other changes in plain types."""
        return report.describe_payload(self.product.robot, self.payload)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the result to `path` as JSON, and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        from symid.environment import write_file
        from symid.serialization import write_json

        return write_file(Path(path), write_json(self.to_dict()) + "\n")


def list_payload_side(side: PayloadSide) -> "GivenSide":
    """Return one side of a payload: a fit, files or recordings."""
    entries = side if isinstance(side, Sequence) and not isinstance(side, str) else (side,)
    found = (entry.log if isinstance(entry, Logged) else entry for entry in entries)
    return tuple(entry.recording if isinstance(entry, Log) else entry for entry in found)
