"""Errors found while numbers are computed, raised as themselves where JAX lets them."""

from collections.abc import Sequence

import equinox as eqx
import jax.extend as jex
import jax.numpy as jnp
import numpy as np
from jax.interpreters import batching, mlir
from jaxtyping import Array, Bool, Int


class DerivativeError(eqx.EquinoxRuntimeError):
    """A derivative could not be computed."""


class DegenerateEigenvalueError(DerivativeError):
    """A derivative was asked for that does not exist: of single members of a cluster of equal eigenvalues.

    It arrives as itself where JAX runs operation by operation, as in `jax.grad` outside of `jit`. A compiled program cannot
    raise a Python class: under `equinox.filter_jit` the same message arrives as `equinox.EquinoxRuntimeError`, of which this
    is a subclass, and under `jax.jit` inside a `jax.errors.JaxRuntimeError`. All three are `RuntimeError`.
    """


def raise_if(
    x: Array,
    wrong: Bool[Array, ""],
    which: Int[Array, ""],
    messages: Sequence[str],
    kind: type[DerivativeError],
) -> Array:
    """x; an error of this kind with `messages[which]` where something is wrong. For what is never differentiated."""
    return _checked_p.bind(x, wrong, which, messages=tuple(messages), kind=kind)


_checked_p = jex.core.Primitive("checked")


@_checked_p.def_impl
def _(x, wrong, which, *, messages, kind):  # constants come as NumPy arrays
    if np.any(wrong):
        raise kind(messages[int(np.max(which))])
    return x


@_checked_p.def_abstract_eval
def _(x, wrong, which, *, messages, kind):
    del wrong, which, messages, kind
    return x


def _compiled(x: Array, wrong: Array, which: Array, *, messages: tuple[str, ...], kind: type) -> Array:
    del kind
    return eqx.branched_error_if(x, wrong, which, messages)


def _batched(arguments, dims, *, messages, kind):
    x, wrong, which = arguments
    wrong = jnp.asarray(wrong)
    which = jnp.where(wrong, which, 0).max()  # of those that are wrong, the last one's message
    return _checked_p.bind(x, wrong.any(), which, messages=messages, kind=kind), dims[0]


mlir.register_lowering(_checked_p, mlir.lower_fun(_compiled, multiple_results=False))
batching.primitive_batchers[_checked_p] = _batched
