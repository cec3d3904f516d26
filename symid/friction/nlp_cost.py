"""The objective over the physical parameters with exact first and second derivatives.

FrictionProblem -> NlpCost.

    f(x) = |y - Q R t(x)|^2 / scale,   t(x) = sum_k c_k(x) Phi_k(v; s(x)),   (c, s) = mixing^-1 x

CasADi differentiates the law's one definition sample by sample; R and the elimination Q of what stands beside
friction are linear and act on t, its gradient and its Hessian alike.

Supported: every static law; the derivatives at a kink are those of one side.
Not supported: R that is not linear.
"""

from typing import Any

import numpy as np

from symid.arrays import FloatArray
from symid.friction.problem import FrictionProblem
from symid.joint.friction_law import FrictionLaw, OperatorFriction

__all__ = ["NlpCost"]

_TINY = 1e-100


class NlpCost:
    """f, its gradient and Hessian; the last point is kept, as the solver asks for it several times."""

    def __init__(self, problem: FrictionProblem, scale: float) -> None:
        """Build the derivatives of the law; f is J over `scale`."""
        self.problem, self.scale, self.evaluations = problem, scale, 0
        self.function = _build_function(problem.law)
        self.inputs = np.vstack([problem.samples.inputs[name] for name in problem.law.inputs])
        self.size = len(problem.law.physical)
        self.upper = np.triu_indices(self.size)
        self.key = b""
        self.kept: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def find_value(self, x: FloatArray) -> float:
        """Return f at x (n,)."""
        errors = self._find_state(x)[0]
        return float(errors @ errors) / self.scale

    def find_gradient(self, x: FloatArray) -> FloatArray:
        """Return df/dx: (n,)."""
        errors, slopes, _ = self._find_state(x)
        return np.asarray(slopes.T @ errors * (2.0 / self.scale))

    def find_hessian(self, x: FloatArray) -> FloatArray:
        """Return d2f/dx2: (n, n)."""
        _, slopes, bends = self._find_state(x)
        hessian = slopes.T @ slopes
        second = np.zeros_like(hessian)
        second[self.upper] = bends
        second += np.triu(second, 1).T
        return np.asarray((hessian + second) * (2.0 / self.scale))

    def _find_state(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return errors (M,), their derivatives (M, n), and errors' sum over second ones, upper triangle."""
        if self.kept is None or self.key != x.tobytes():
            self.evaluations += 1
            samples = self.problem.samples
            rows = [np.asarray(part, dtype=np.float64).T for part in self.function(x, self.inputs)]
            passed = samples.pass_columns(np.hstack(rows))
            basis = self.problem.basis
            errors = passed[:, 0] - self.problem.target
            errors = errors - basis @ (basis.T @ errors)
            slopes = passed[:, 1 : 1 + self.size]
            slopes = slopes - basis @ (basis.T @ slopes)
            self.kept = errors, slopes, passed[:, 1 + self.size :].T @ errors
            self.key = x.tobytes()
        return self.kept


def _build_function(law: FrictionLaw) -> Any:  # noqa: ANN401  # a function of casadi
    """Return (x (n), inputs (i, N)) -> torque (1, N), gradient (n, N), upper triangle of the Hessian."""
    import casadi

    x = casadi.SX.sym("x", len(law.physical))
    inputs = casadi.SX.sym("inputs", len(law.inputs))
    values = casadi.mtimes(casadi.DM(np.array(law.unmixing, dtype=np.float64)), x)
    count = len(law.linear)
    named = {name: inputs[place] for place, name in enumerate(law.inputs)}
    shape = [values[count + place] for place in range(len(law.shape))]
    columns = law.columns(_build_carrier(), named, shape)
    torque = casadi.dot(values[:count], casadi.vertcat(*columns))
    hessian, gradient = casadi.hessian(torque, x)
    size = len(law.physical)
    places = [hessian[i, j] for i in range(size) for j in range(i, size)]
    return casadi.Function("torque", [x, inputs], [torque, gradient, casadi.vertcat(*places)])


def _build_carrier() -> OperatorFriction[Any]:
    import casadi

    return OperatorFriction(
        zero=casadi.SX(0.0),
        one=casadi.SX(1.0),
        exp=casadi.exp,
        tanh=casadi.tanh,
        sin=casadi.sin,
        cos=casadi.cos,
        sign=casadi.sign,
        absolute=casadi.fabs,
        maximum=casadi.fmax,
        minimum=casadi.fmin,
        # At zero, derivatives would hold its logarithm and negative powers, although they vanish.
        power=lambda base, exponent: casadi.fmax(base, _TINY) ** exponent,
    )
