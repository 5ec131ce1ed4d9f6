"""Strict mode for every test: float64, no silent dtype or rank promotion, shapes and dtypes checked at run time."""

import os
from pathlib import Path

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

with install_import_hook("jaxkvf", "beartype.beartype"):
    import jaxkvf  # noqa: F401


@pytest.fixture(scope="session")
def real_mesh_folder() -> Path:
    """The folder of real meshes, by `JAXKVF_MESHES`; not part of the project."""
    default = Path(__file__).resolve().parents[2] / "shared" / "meshes"
    folder = Path(os.environ.get("JAXKVF_MESHES", default))
    if not any(folder.glob("*.obj")):
        reason = f"no meshes in {folder}: set JAXKVF_MESHES to a folder of OBJ files"
        pytest.fail(reason) if os.environ.get("CI") == "true" else pytest.skip(reason)
    return folder
