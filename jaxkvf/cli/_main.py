"""The command line. Each command is a module beside this one, with `add_to(commands)`; it is listed here.

Exit codes: 0 done, 1 could not (a message says why) or the mesh has errors, 2 wrong use.
"""

import argparse
import json
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import jax

from ..extras import extra
from . import _check, _fields, _flow, _repair, _report, _symmetrize
from ._messages import spoken

_COMMANDS = (_check, _repair, _fields, _flow, _symmetrize, _report)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        console = extra("rich.console").Console(stderr=options.json)
        _enable_float64_and_cache()
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: console.print(
                f"warning: {spoken(message)}", style="yellow"
            )
            report = options.run(options, console)
    except (ValueError, OSError, RuntimeError, MemoryError, ImportError) as failure:
        print(f"jaxkvf: {spoken(failure)}", file=sys.stderr)
        return 1
    if options.json:
        json.dump(report, sys.stdout, indent=2)
        print()
    return 0 if report.get("ok", True) else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxkvf", description="Continuous intrinsic symmetry of triangle meshes: Killing vector fields."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in _COMMANDS:
        command.add_to(commands)
    return parser


def _enable_float64_and_cache() -> None:
    jax.config.update("jax_enable_x64", True)
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    jax.config.update("jax_compilation_cache_dir", str(caches / "jaxkvf"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
