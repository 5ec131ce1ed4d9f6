"""What an eigensolver returns, and how it says what went wrong."""

import equinox as eqx
from jaxtyping import Array, Float


class RESULTS(eqx.Enumeration):
    """Outcome of an eigensolve; `RESULTS[solution.result]` is the message, empty for success."""

    successful = ""
    max_steps_reached = (
        "The eigensolver stopped at its maximum number of steps before all residuals reached the tolerance. "
        "Raise `max_steps`, loosen the tolerance, or pass another solver; `throw=False` returns the best found."
    )
    stagnated = (
        "The residuals stopped falling before they reached the tolerance. Loosen it if rounding stands in its way (or use "
        "float64), pass another preconditioner (this one may not be positive definite, or not finite), or use ScipyEigsh."
    )
    nonfinite_input = (
        "The matrices of the eigenproblem hold NaN or infinity. "
        "Check the positions: triangles of zero area or NaN coordinates give such matrices."
    )
    indefinite_mass = (
        "B is not positive definite, so the problem has no lowest eigenvalue. With the `dec` discretization this means "
        "cotangent weights of inner edges that are not positive: `Dec(delaunay=False)` on a mesh that is not Delaunay. "
        "Use `Dec()` or `regge`."
    )
    negative_energy = (
        "A is declared positive semi-definite and has an eigenvalue far below zero: its entries are lost in rounding. "
        "Triangles that are very thin for their size make such matrices. Use float64 if you do not."
    )


class EigenSolution(eqx.Module):
    """The k smallest eigenpairs, ascending."""

    eigenvalues: Float[Array, " k"]
    """Differentiable with respect to the problem's arrays."""
    eigenvectors: Float[Array, "n k"]
    """Columns, orthonormal in B. Differentiable outside of clusters; their sign is the solver's choice."""
    residuals: Float[Array, " k"]
    """‖A x − λ B x‖₂ / (‖A‖₂ ‖x‖₂) of each pair, ‖A‖₂ estimated from below within a few per cent."""
    result: RESULTS
    stats: dict[str, Array | int | float]
    """Counts of work done, by name; what is counted depends on the solver."""
