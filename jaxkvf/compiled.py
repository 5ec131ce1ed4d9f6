"""Loops over arrays on the host, compiled by Numba: for graphs, whose algorithms vectorise badly."""

import functools
import inspect
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_T = TypeVar("_T")
_U = TypeVar("_U")


def compiled(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """`function` as machine code, which lets go of Python's lock; a decorator.

    Compiled at the first call with arrays of some types, and kept on disk for later processes where a folder can be written
    to. Numba, too, is loaded at the first call only. Arguments must be arrays that may be written to, else a second program
    is made for those that may not.
    """

    only_once = threading.Lock()  # the first call may come from several threads

    @functools.cache
    def machine_code() -> Callable[_P, _T]:
        import numba  # noqa: PLC0415

        plain = inspect.unwrap(function)  # of what type checkers wrap around it at run time
        try:
            return numba.njit(cache=True, nogil=True)(plain)
        except RuntimeError:  # nowhere to keep it
            return numba.njit(nogil=True)(plain)

    @functools.wraps(function)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        with only_once:
            code = machine_code()
        return code(*args, **kwargs)

    return call


def in_threads(function: Callable[[_U], _T], arguments: Sequence[_U]) -> list[_T]:
    """`map` on all cores, for functions that let go of Python's lock."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(function, arguments))
