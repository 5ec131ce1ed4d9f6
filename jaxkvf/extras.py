"""Packages that may be missing: imported when they are needed and not before, and if they are missing, what to install."""

import importlib
from types import ModuleType

_PACKAGES = {
    "rich": ("rich", "cli"),
    "polyscope": ("polyscope", "viz"),
    "matplotlib": ("matplotlib", "viz"),
    "jupyter_threejs_sage": ("jupyter-threejs-sage", "report"),
    "potpourri3d": ("potpourri3d", "patterns"),
    "trimesh": ("trimesh", "patterns"),
    "PIL": ("pillow", "patterns"),
    "igl": ("libigl", "geodesics"),
    "cvxopt": ("cvxopt", "cholmod-gpl"),
    "pyvista": ("pyvista", None),
}
"""For each package that is imported: its name where it is installed from, and the extra of jaxkvf that brings it."""


def extra(module: str) -> ModuleType:
    """A module of a package that jaxkvf works without until now.

    Raises:
        ImportError: it is not installed, or does not load; the message says what to install.
    """
    package = module.partition(".")[0]
    name, brought_by = _PACKAGES[package]
    try:
        return importlib.import_module(module)
    except ImportError as error:
        wanted = name if brought_by is None else f'"jaxkvf[{brought_by}]"'
        raise ImportError(f"this needs {name}: pip install {wanted} ({error})", name=package) from error
