"""What works on the host says so where it is traced."""

import jax
from jax.core import Tracer


def check_on_host(name: str, *values: object) -> None:
    """Raises `TypeError` where one of the values is traced: `name` works on the host."""
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values)):
        raise TypeError(
            f"{name} runs on the host, on numbers: call it outside of jit, grad, vmap and other transformations"
        )
