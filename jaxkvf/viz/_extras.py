"""The packages of the extra `jaxkvf[viz]`, imported when a picture is made and not before."""

import importlib
from types import ModuleType


def extra(module: str) -> ModuleType:
    """Import a module of matplotlib or polyscope.

    Raises:
        ImportError: it is not installed, or does not load; the message says what mends it.
    """
    package = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ImportError as error:
        message = f'jaxkvf.viz needs {package}: pip install "jaxkvf[viz]" ({error})'
        raise ImportError(message, name=package) from error
