"""The renderer: what it refuses, what it leaves behind, and what it says where it cannot run."""

import ctypes
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import install_import_hook
from pictures import about_z, drawn, read, sphere

with install_import_hook("jaxkvf", "beartype.beartype"):  # jaxkvf itself does not import jaxkvf.viz
    from jaxkvf import viz
    from jaxkvf.viz import _session

SIZE = (320, 240)
X, F = sphere(60)


@pytest.mark.parametrize(
    ("message", "changes"),
    [
        ("must end in .png", {"path": "a.jpg"}),
        ("row 3 is not", {"vertices": np.where(np.arange(60)[:, None] == 3, np.nan, X)}),
        ("every face has area 0", {"vertices": X * [0.0, 0.0, 1.0]}),
        ("there are 60 vertices", {"faces": F + 1}),
        ("F ≥ 1", {"faces": F[:0]}),
        (
            r"vectors must be finite; row 7 is not \(1 such rows\)",
            {"vectors": np.where(X[7] == X, np.inf, X)},
        ),
        ("size must be", {"size": (10, 100)}),
        ("arrows must be", {"arrows": -1}),
        ("values must be 60", {"values": X[:, 0] * np.nan}),
        ("the lower first", {"limits": (1.0, 1.0)}),
        ("within 0 … 180", {"crease_angle": -1.0}),
        ("parallel", {"view": ((0.0, 1.0, 0.0), (0.0, 2.0, 0.0))}),
        ("finite numbers", {"view": ((0.0, 1.0), (0.0, 2.0, 0.0))}),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, message, changes):
    page = {"path": "a.png", "size": SIZE, "view": None}
    scene = {"vertices": X, "faces": F, "vectors": about_z(X), "arrows": 5}
    page, scene = ({key: changes.get(key, given[key]) for key in given} for given in (page, scene))
    scene |= {key: changes[key] for key in changes if key not in page}
    with pytest.raises(ValueError, match=message):
        viz.render(tmp_path / page["path"], viz.Scene(**scene), size=page["size"], view=page["view"])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        viz.render(tmp_path / "nowhere" / "a.png", viz.Scene(X, F))


def test_a_failure_leaves_no_scene_and_keeps_the_old_file(offscreen, tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(*args, **kwargs):
        raise OSError("no room")

    with monkeypatch.context() as patch:
        patch.setattr(offscreen, "screenshot_to_buffer", fail)
        with pytest.raises(OSError, match="no room"):
            viz.render(path, viz.Scene(X, F), size=SIZE)
    assert not offscreen.has_surface_mesh("surface 0")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail)
        with pytest.raises(OSError, match="no room"):
            viz.render(path, viz.Scene(X, F), size=SIZE)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]
    viz.render(path, viz.Scene(X, F), size=SIZE)
    assert drawn(read(path)).any() and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("module", ["polyscope", "matplotlib"])
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, module):
    monkeypatch.setattr(_session, "missing_libraries", list)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf'needs {module}: pip install "jaxkvf\[viz\]"'):
        viz.render(tmp_path / "a.png", viz.Scene(X, F, vectors=X), size=SIZE)
    assert list(tmp_path.iterdir()) == []


def test_missing_system_libraries_are_named_before_polyscope_starts(tmp_path, monkeypatch):
    def absent(name, *args, **kwargs):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", absent)
    monkeypatch.setattr(_session, "_started_by", None)
    with pytest.raises(RuntimeError, match=r"libX11.so.6, libEGL.so.1, libGL.so.1: run .ci/system-packages"):
        viz.render(tmp_path / "a.png", viz.Scene(X, F), size=SIZE)
    assert list(tmp_path.iterdir()) == []


def test_another_thread_is_told_so(offscreen, tmp_path):
    errors = []

    def render():
        try:
            viz.render(tmp_path / "a.png", viz.Scene(X, F), size=SIZE)
        except RuntimeError as error:
            errors.append(str(error))

    thread = threading.Thread(target=render)
    thread.start()
    thread.join()
    assert len(errors) == 1 and "another thread" in errors[0]


def test_the_callers_matplotlib_style_neither_changes_nor_shows(offscreen, tmp_path):
    import matplotlib as mpl  # noqa: PLC0415  only where pictures are made

    def strip(name):
        viz.render(tmp_path / name, viz.Scene(X, F, "caption", vectors=X, arrows=0), size=(200, 200))
        return read(tmp_path / name)

    plain = strip("a.png")
    with mpl.rc_context({"font.family": "serif", "font.weight": "bold", "figure.facecolor": "black"}):
        style = dict(mpl.rcParams)
        np.testing.assert_array_equal(strip("b.png"), plain)
        assert dict(mpl.rcParams) == style


FRESH = """
import sys
import numpy as np
from jaxkvf import viz
assert not {"polyscope", "matplotlib"} & set(sys.modules), "imported too early"
x, f = np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
try:
    for name in ("a.png", "b.png"):
        viz.render(name, viz.Scene(x, f, vectors=x), size=(100, 100))
except RuntimeError as error:
    print(error)
"""


def fresh_process(folder, **environment):
    from matplotlib import get_cachedir  # noqa: PLC0415  only where pictures are made

    return subprocess.run(
        [sys.executable, "-W", "error", "-c", FRESH],
        cwd=folder,
        env=os.environ | {"HOME": str(folder), "MPLCONFIGDIR": get_cachedir()} | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def test_a_fresh_process_writes_its_pictures_and_nothing_else(offscreen, tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    done = fresh_process(folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    first, second = sorted(folder.iterdir())
    assert (first.name, second.name) == ("a.png", "b.png")
    np.testing.assert_array_equal(read(first), read(second))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL is how Linux renders off-screen")
def test_a_missing_driver_is_an_error_and_no_crash(offscreen, tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    done = fresh_process(folder, __EGL_VENDOR_LIBRARY_DIRS="/nonexistent", __EGL_VENDOR_LIBRARY_FILENAMES="")
    assert done.returncode == 0 and "a graphics driver is probably missing" in done.stdout
    assert list(folder.iterdir()) == []
