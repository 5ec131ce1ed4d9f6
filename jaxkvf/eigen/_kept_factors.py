"""Factorizations that derivatives find again: kept on the host, while arrays can only carry their name.

The name is a fingerprint of the matrices, so that what JAX may do with a callback (run it twice, or not at all) changes
nothing; a factor that is no longer there is made again.
"""

import hashlib
import threading
import weakref
from collections import OrderedDict
from typing import NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import UInt32

from ._factorization import Solve

NAME_WORDS = 4
_MOST_UNKNOWNS = 100_000  # together, of the factors that compiled programs leave behind
Name = UInt32[np.ndarray | jax.Array, "4"]


class Factor:
    """A + sB in factors."""

    def __init__(self, shift: float, solve: Solve, tried: int, size: int) -> None:
        self.shift, self.solve, self.tried, self.size = shift, solve, tried, size


class _Kept(NamedTuple):
    alive: "weakref.WeakValueDictionary[bytes, Factor]"
    recent: "OrderedDict[bytes, Factor]"
    """Held for compiled programs, which cannot say when they are done with one: the latest, of a bounded size."""
    lock: threading.Lock


_kept = _Kept(weakref.WeakValueDictionary(), OrderedDict(), threading.Lock())


def name_of(A: sp.csc_array, B: sp.csc_array, method: str) -> np.ndarray:
    """The fingerprint of a factorization, `[4]` unsigned integers."""
    digest = hashlib.blake2b(method.encode(), digest_size=4 * NAME_WORDS)
    for matrix in (A, B):
        for array in (matrix.indptr, matrix.indices, matrix.data):
            digest.update(np.ascontiguousarray(array).data)
    return np.frombuffer(digest.digest(), np.uint32)


def keep_while_alive(name: np.ndarray, factor: Factor) -> jax.Array:
    """The name as an array of JAX: the factor lives as long as this array."""
    with jax.core.eval_context():  # an array, where a derivative being taken would make a tracer of it
        array = jnp.asarray(name)
    with _kept.lock:
        _kept.alive[name.tobytes()] = factor
    weakref.finalize(array, _let_go, factor).atexit = False
    return array


def keep_for_a_while(name: np.ndarray, factor: Factor) -> None:
    """Until others have come after it."""
    with _kept.lock:
        key = name.tobytes()
        _kept.alive[key] = factor
        _kept.recent[key] = factor
        _kept.recent.move_to_end(key)
        while sum(kept.size for kept in _kept.recent.values()) > _MOST_UNKNOWNS:
            _kept.recent.popitem(last=False)


def kept(name: np.ndarray) -> Factor | None:
    """The factor of this name, where it is still there."""
    with _kept.lock:
        return _kept.alive.get(np.asarray(name, np.uint32).tobytes())


def _let_go(factor: Factor) -> None:
    del factor
