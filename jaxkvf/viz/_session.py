"""The one polyscope session of a process: started off-screen on first use; errors say what is missing."""

import ctypes
import os
import sys
import threading
from types import ModuleType

from ..extras import extra
from ._material import load_materials

SAMPLES_PER_PIXEL_SIDE = 3
SYSTEM_LIBRARIES = ("libX11.so.6", "libEGL.so.1", "libGL.so.1")

_started_by: tuple[int, int] | None = None


def polyscope() -> ModuleType:
    """The polyscope module, initialised without a window; cheap after the first call.

    Raises:
        ImportError: polyscope or matplotlib is not installed.
        RuntimeError: a system library or a graphics driver is missing; polyscope was started by other code,
            whose scene a picture would erase, or by us in another thread or process: OpenGL forbids that.
    """
    global _started_by  # noqa: PLW0603  polyscope itself is one global object
    here = (os.getpid(), threading.get_ident())
    if _started_by is not None and _started_by != here:
        raise RuntimeError(
            "jaxkvf.viz already renders in another thread, or in the process that this one was forked from; "
            "render from one thread, and start worker processes with the 'spawn' method"
        )
    if _started_by is None:
        absent = missing_libraries()
        if absent:
            raise RuntimeError(
                f"off-screen rendering needs {', '.join(absent)}: run .ci/system-packages, "
                "or apt-get install libegl1 libgl1 libgl1-mesa-dri libx11-6"
            )
    ps = extra("polyscope")
    if _started_by is None:
        _start(ps)
        _started_by = here
    return ps


def missing_libraries() -> list[str]:
    """Names of the system libraries that off-screen rendering needs on Linux and the loader cannot find.

    Asked before polyscope starts: without libEGL, polyscope 2.6 ends the process with a segmentation fault.
    """
    if not sys.platform.startswith("linux"):
        return []
    absent = []
    for name in SYSTEM_LIBRARIES:
        try:
            ctypes.CDLL(name)
        except OSError:
            absent.append(name)
    return absent


def _start(ps: ModuleType) -> None:
    if ps.is_initialized():
        raise RuntimeError(
            "polyscope was already started by other code in this process, and a picture would erase its "
            "scene; render with jaxkvf.viz in a process of its own"
        )
    ps.set_allow_headless_backends(True)
    ps.set_use_prefs_file(False)
    ps.set_verbosity(0)
    ps.set_errors_throw_exceptions(True)
    ps.set_display_message_popups(False)
    try:
        ps.init("openGL3_egl" if sys.platform.startswith("linux") else "auto")
    except RuntimeError as error:
        raise RuntimeError(
            f"polyscope could not start off-screen ({str(error).strip()}); a graphics driver is probably "
            "missing: run .ci/system-packages, which installs Mesa's software renderer"
        ) from error
    load_materials(ps)
    ps.set_window_size(64, 64)
    ps.set_SSAA_factor(SAMPLES_PER_PIXEL_SIDE)
    ps.screenshot_to_buffer()  # polyscope 2.6 draws its first supersampled frame without supersampling
