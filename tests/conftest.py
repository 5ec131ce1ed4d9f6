"""Strict mode for every test: float64, no silent dtype or rank promotion, shapes and dtypes checked at run time."""

import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

with install_import_hook("jaxkvf", "beartype.beartype"):
    import jaxkvf  # noqa: F401


_MAPS = Path("/proc/self/maps")  # Linux only
_MANY_MAPS = 20_000


@pytest.fixture(autouse=True, scope="module")
def compiled_programs_are_dropped() -> Iterator[None]:
    """Every program XLA compiles for a CPU takes memory maps, of which Linux grants a process 65,530: then it crashes."""
    yield
    if _MAPS.exists() and _MAPS.read_text().count("\n") > _MANY_MAPS:
        jax.clear_caches()


@pytest.fixture(scope="session")
def real_mesh_folder() -> Path:
    """The folder of real meshes, by `JAXKVF_MESHES`; not part of the project."""
    default = Path(__file__).resolve().parents[2] / "shared" / "meshes"
    folder = Path(os.environ.get("JAXKVF_MESHES", default))
    if not any(folder.glob("*.obj")):
        reason = f"no meshes in {folder}: set JAXKVF_MESHES to a folder of OBJ files"
        pytest.fail(reason) if os.environ.get("CI") == "true" else pytest.skip(reason)
    return folder


@pytest.fixture(scope="session")
def offscreen() -> ModuleType:
    """polyscope; skips where nothing can be rendered; in continuous integration that is a failure."""
    from jaxkvf.viz._session import polyscope  # noqa: PLC0415  not before the tests have put their hook on jaxkvf.viz

    try:
        return polyscope()
    except (ImportError, RuntimeError) as error:
        if os.environ.get("CI", "").lower() in {"1", "true"}:
            pytest.fail(f"CI must be able to render: {error}")
        pytest.skip(f"nothing can be rendered here: {error}")
