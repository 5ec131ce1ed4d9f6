"""How far the most symmetric field of a piece is from a symmetry."""

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from jaxtyping import Int
from scipy.sparse.linalg import LinearOperator, eigsh

from ..eigen import default_factorization
from ..killing import Pieces

_DENSE_BELOW = 300  # unknowns


def lowest(pieces: Pieces, faces: Int[np.ndarray, " n"]) -> float:
    """Smallest λ · area of the piece made of these faces; infinite where there is none. Dimensionless."""
    if not faces.size:
        return np.inf
    A, B, _ = pieces.matrices(faces)
    area, size = float(pieces.areas[faces].sum()), A.diagonal().size
    if size <= _DENSE_BELOW:
        values = scipy.linalg.eigh(A.toarray(), B.toarray(), eigvals_only=True, subset_by_index=[0, 0])
        return float(values[0]) * area
    solve = default_factorization().factorize(sp.csc_array(A + B / area))
    assert solve is not None  # A is positive semi-definite, B positive definite
    inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)  # pyright: ignore[reportCallIssue]
    start = np.random.default_rng(0).standard_normal(size)
    values = eigsh(A, 1, M=B, sigma=-1 / area, OPinv=inverse, v0=start, return_eigenvectors=False)
    return float(values[0]) * area
