"""What a robot carries: mass, centre of mass and inertia, from logs or fits with it and without it.

Input: a robot, for both sides a fit or logs. Output: `PayloadResult`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, final

from symid.api.log import Log, Logged, LogLike
from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy and SymPy
    from symid.api.robot import RobotModel
    from symid.arrays import FloatArray
    from symid.parameters.payload import Payload, PayloadQuantity
    from symid.report.blocks import Block
    from symid.tasks.identified import GivenResult
    from symid.tasks.payload import GivenSide, PayloadFinding

__all__ = ["PayloadEstimator", "PayloadResult", "PayloadRows", "PayloadSide", "find_model_payload"]

PayloadRows = Literal["torque", "momentum"]
PayloadEstimator = Literal["ols", "wls"]
PayloadSide: TypeAlias = "GivenResult | LogLike | Sequence[LogLike]"
"""One side: a fit or its file, or logs."""


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PayloadResult(Result):
    """What a robot carries, in the frame that the robot file gives to the link; a body that can exist.

    Attributes:
        product: the payload, how surely each quantity is known, what cannot be told.

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
        """Return all that was found."""
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
        """Return what speaks against it: what is not identifiable, what else changed between both sides."""
        from symid.report.payload_text import warn_payload

        return tuple(dict.fromkeys((*self.product.notices, *warn_payload(self.payload))))

    def summarise(self) -> str:
        """Return the mass and the link."""
        return f"{self.product.robot.name}: {self.mass:.4g} kg on the link of joint {self.joint!r}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return the table of what was identified, and what was refused, with the reasons."""
        from symid.report.payload_text import show_payload

        return show_payload(self.product.robot, self.payload)

    def to_dict(self) -> dict[str, object]:
        """Return quantities, deviations and what changed besides in plain types."""
        from symid.report.payload_text import describe_payload

        return describe_payload(self.product.robot, self.payload)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the result to `path` as JSON, and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        from symid.identification.storage import write_file
        from symid.json_text import write_json

        return write_file(Path(path), write_json(self.to_dict()) + "\n")


def find_model_payload(
    model: "RobotModel",
    loaded: PayloadSide,
    empty: PayloadSide,
    *,
    joint: str | None,
    mass: float | None,
    rows: PayloadRows,
    estimator: PayloadEstimator,
) -> PayloadResult:
    """Return what the robot carries; see `RobotModel.payload`."""
    from symid.tasks.payload import PayloadTask, find_carried

    task = PayloadTask(
        joint=joint,
        mass=mass,
        rows=rows,
        estimator=estimator,
        prepare=lambda: model.library,
        progress=model.progress,
    )
    found = find_carried(model.description, _list_given(loaded), _list_given(empty), task)
    return PayloadResult(product=found)


def _list_given(side: PayloadSide) -> "GivenSide":
    entries = side if isinstance(side, Sequence) and not isinstance(side, str) else (side,)
    found = (entry.log if isinstance(entry, Logged) else entry for entry in entries)
    return tuple(entry.recording if isinstance(entry, Log) else entry for entry in found)
