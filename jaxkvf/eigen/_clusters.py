"""Clusters of equal eigenvalues: single members have no derivative, symmetric functions of them do.

Where m eigenvalues coincide, a change of the problem splits them into the eigenvalues of an m × m matrix dΛ, which are no
linear function of it; its trace is. Reverse mode knows what is asked, by the cotangents that arrive, and can refuse.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._failure import DegenerateEigenvalueError, raise_if

_SAME = 1e-5  # cotangents or rates this close, relative to the largest, count as equal


def cluster_labels(
    eigenvalues: Float[Array, " k"], *, rtol: float = 1e-2, atol: float | Float[Array, ""] = 0.0
) -> Int[Array, " k"]:
    """Number of the cluster each of the ascending eigenvalues belongs to, from 0.

    Neighbours belong together while their gap is at most `atol + rtol · |λ|` of the larger in absolute value.
    """
    larger = jnp.maximum(jnp.abs(eigenvalues[1:]), jnp.abs(eigenvalues[:-1]))
    apart = jnp.diff(eigenvalues) > atol + rtol * larger
    return jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(apart, dtype=jnp.int32)])


def cluster_sums(eigenvalues: Float[Array, " k"], labels: Int[Array, " k"]) -> Float[Array, " k"]:
    """For each eigenvalue the sum over its cluster: differentiable where single members of a cluster are not."""
    together = (labels[:, None] == labels[None, :]).astype(eigenvalues.dtype)
    return together @ eigenvalues


def cluster_means(eigenvalues: Float[Array, " k"], labels: Int[Array, " k"]) -> Float[Array, " k"]:
    """For each eigenvalue the mean over its cluster."""
    return cluster_sums(eigenvalues, labels) / cluster_sums(jnp.ones_like(eigenvalues), labels)


def individual(
    energies: Float[Array, "k k"], labels: Int[Array, " k"], cut: Bool[Array, " k"]
) -> Float[Array, "k k"]:
    """Λ as it is; in reverse mode an error where single eigenvalues of a cluster are asked for.

    Forward mode does not know what will be asked, and gives each member of a cluster the rate of its mean, with which all
    that may be asked comes out right; NaN in a cluster that is cut.

    Args:
        energies: Λ, with the derivative dΛ inside the clusters.
        labels: of the clusters.
        cut: members of a cluster that goes on beyond the k known, which has no derivative at all.
    """
    return _with_linear_derivative(
        energies, (labels, cut), _means_of_clusters, _error_naming_cluster(_uneven)
    )


def averaged(
    energies: Float[Array, "k k"], labels: Int[Array, " k"], cut: Bool[Array, " k"]
) -> Float[Array, "k k"]:
    """Λ as it is; members of a cluster change at the rate of its mean. An error, or NaN, only where a cluster is cut."""
    return _with_linear_derivative(energies, (labels, cut), _means_of_clusters, _means_of_complete)


def whole(
    energies: Float[Array, "k k"], labels: Int[Array, " k"], cut: Bool[Array, " k"]
) -> Float[Array, "k k"]:
    """Λ as it is, to be differentiated as a matrix. An error, or NaN, only where a cluster is cut."""
    return _with_linear_derivative(energies, (labels, cut), _nan_in_cut, _error_naming_cluster(_incomplete))


def without_gauge(
    vectors: Float[Array, "n k"], labels: Int[Array, " k"], cut: Bool[Array, " k"]
) -> Float[Array, "n k"]:
    """Eigenvectors as they are; in reverse mode an error where the choice of basis in a cluster would matter.

    Forward mode gives the rates of a basis that does not turn inside its space; NaN in a cluster that is cut.
    """
    context = (labels, cut, jax.lax.stop_gradient(vectors))
    return _with_linear_derivative(vectors, context, _nan_in_cut, _error_naming_cluster(_gauge_seen))


_Context = tuple[Array, ...]
_Test = Callable[[_Context, Array], Bool[Array, " k"]]


def _uneven(context: _Context, rates: Float[Array, "k k"]) -> Bool[Array, " k"]:
    """Whether the rates of the cluster that an index belongs to are no multiple of the identity."""
    labels, _ = context
    deviation = jnp.abs(rates - jnp.diag(cluster_means(rates.diagonal(), labels)))
    in_cluster = jnp.where(labels[:, None] == labels[None, :], deviation, 0).max(axis=1)
    return (in_cluster > _SAME * jnp.abs(rates).max()) | _incomplete(context, rates)


def _incomplete(context: _Context, rates: Float[Array, "k k"]) -> Bool[Array, " k"]:
    """Whether an index belongs to a cluster that is cut, and its rates matter."""
    _, cut = context
    return cut & (jnp.abs(rates).max(axis=1) > 0)


def _gauge_seen(context: _Context, cotangent: Float[Array, "n k"]) -> Bool[Array, " k"]:
    """Whether the cotangent depends on the choice of basis in the cluster of an index."""
    labels, cut, vectors = context
    turning = vectors.T @ cotangent
    scale = jnp.linalg.norm(vectors, axis=0).max() * jnp.linalg.norm(cotangent, axis=0).max()
    seen = (labels[:, None] == labels[None, :]) & (jnp.abs(turning - turning.T) > _SAME * scale)
    return seen.any(axis=1) | (cut & (jnp.abs(cotangent).max(axis=0) > 0))


def _nan_in_cut(context: _Context, rates: Float[Array, "n k"]) -> Float[Array, "n k"]:
    return jnp.where(context[1][None, :], jnp.nan, rates)


def _means_of_clusters(context: _Context, rates: Float[Array, "k k"]) -> Float[Array, "k k"]:
    return _nan_in_cut(context, jnp.diag(cluster_means(rates.diagonal(), context[0])))


@eqx.filter_custom_jvp
def _with_linear_derivative(
    value: Array,
    context: _Context,
    forward: Callable[[_Context, Array], Array],
    reverse: Callable[[_Context, Array], Array],
) -> Array:
    """The value, whose tangents pass through `forward` and whose cotangents pass through `reverse`."""
    return value


@_with_linear_derivative.def_jvp
def _(primals, tangents):
    value, context, forward, reverse = primals
    # As the solution of the trivial system 1 t = t, which JAX lets us solve one way and transpose another, under every
    # transformation.
    passed = jax.lax.custom_linear_solve(
        lambda t: t, tangents[0], lambda _, t: forward(context, t), lambda _, t: reverse(context, t)
    )
    return _with_linear_derivative(value, context, forward, reverse), passed


def _means_of_complete(context: _Context, rates: Float[Array, "k k"]) -> Float[Array, "k k"]:
    rates = _error_naming_cluster(_incomplete)(context, rates)
    return jnp.diag(cluster_means(rates.diagonal(), context[0]))


def _error_naming_cluster(test: _Test) -> Callable[[_Context, Array], Array]:
    """The identity for rates; an error where the test finds something wrong in a cluster."""

    def checked(context: _Context, rates: Array) -> Array:
        wrong, labels = test(context, rates), context[0]
        k = len(labels)
        here = labels == labels[jnp.argmax(wrong)]
        first, last = jnp.argmax(here), k - 1 - jnp.argmax(here[::-1])
        messages = [_message(i, j, k) for i in range(k) for j in range(i, k)]
        position = first * k - first * (first - 1) // 2 + last - first  # of this pair among them
        return raise_if(rates, wrong.any(), position, messages, DegenerateEigenvalueError)

    return checked


def _message(first: int, last: int, k: int) -> str:
    members = f"Eigenvalues {first} to {last}" if last > first else f"Eigenvalue {first}"
    beyond = f", which may go on beyond the {k} asked for" if last == k - 1 else ""
    return (
        f"{members} (counted from 0) {'are' if last > first else 'is'} in one cluster of equal eigenvalues{beyond}: single "
        "members of a cluster and their eigenvectors have no derivative. Differentiate a symmetric function of the whole "
        "cluster (`cluster_sums`, `spectral_sum`, a projector), or pass degenerate='mean' to share the derivative of the "
        "cluster's mean among its members; where the cluster goes on beyond k, ask for more or fewer eigenvalues."
    )
