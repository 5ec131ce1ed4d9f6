"""The packages that pictures need, imported when one is made and not before."""

import importlib
from types import ModuleType

NOT_IN_VIZ = {"pyvista": "pyvista", "trimesh": "trimesh"}
"""What to install for a package that the extra `jaxkvf[viz]` does not bring."""


def extra(module: str) -> ModuleType:
    """Import a module of matplotlib or polyscope, or of a package that a mesh is handed over to.

    Raises:
        ImportError: it is not installed, or does not load; the message says what mends it.
    """
    package = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ImportError as error:
        wanted = NOT_IN_VIZ.get(package, '"jaxkvf[viz]"')
        message = f"jaxkvf.viz needs {package}: pip install {wanted} ({error})"
        raise ImportError(message, name=package) from error
