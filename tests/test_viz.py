"""Pictures: the right size, the object in them, the right colours, nothing left behind, errors that help."""

import ctypes
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import install_import_hook
from scipy.spatial import ConvexHull, cKDTree

with install_import_hook("jaxkvf", "beartype.beartype"):  # jaxkvf itself does not import jaxkvf.viz
    from jaxkvf import viz
    from jaxkvf.viz import _session
    from jaxkvf.viz._arrows import REACH, arrows_at
    from jaxkvf.viz._camera import FIELD_OF_VIEW, MARGIN, fit_camera
    from jaxkvf.viz._colors import SPEED_MAP, color_map
    from jaxkvf.viz._displacement import color_limits, displacement, mean_edge_length, vertex_normals
    from jaxkvf.viz._samples import spread_evenly

SIZE = (320, 240)
SIDE = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""From the side: the axis of revolution z is upright in the middle."""
DISK = np.pi * ((1 - MARGIN) * SIZE[1] / 2) ** 2 / (SIZE[0] * SIZE[1])
"""Share of the picture that a sphere fills."""


def sphere(count=900):
    """Unit sphere over Fibonacci points, faces outward."""
    i = np.arange(count)
    z, angle = 1 - (2 * i + 1) / count, np.pi * (3 - np.sqrt(5)) * i
    x = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    f = ConvexHull(x).simplices.astype(np.int64)
    inward = np.linalg.det(x[f]) < 0
    f[inward] = f[inward, ::-1]
    return x, f


def annulus(rings=6, spokes=40):
    """Flat ring in the plane z = 0, faces upward."""
    radius, angle = np.linspace(1, 2, rings), 2 * np.pi * np.arange(spokes) / spokes
    x = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1).reshape(-1, 2)
    ring, spoke = (grid.ravel() for grid in np.mgrid[: rings - 1, :spokes])
    a, b = ring * spokes + spoke, ring * spokes + (spoke + 1) % spokes
    f = np.stack([a, a + spokes, b, b, a + spokes, b + spokes], axis=1).reshape(-1, 3)
    return np.pad(x, ((0, 0), (0, 1))), f


def about_z(x):
    return np.cross([0.0, 0.0, 1.0], x - x.mean(axis=0))


def speed_in_row(row):
    """Distance from the axis of the unit sphere's point in the middle column, seen from the `SIDE`."""
    half = np.tan(np.radians(FIELD_OF_VIEW) / 2)
    distance = 1 / np.sin(np.arctan((1 - MARGIN) * half))
    angle = np.arctan((1 - (2 * row + 1) / SIZE[1]) * half)
    along = distance * np.cos(angle) - np.sqrt(1 - (distance * np.sin(angle)) ** 2)
    return np.sqrt(1 - (along * np.sin(angle)) ** 2)


def read(path):
    from matplotlib.image import imread  # noqa: PLC0415  only where pictures are made

    return imread(path)[:, :, :3].astype(np.float64)


def drawn(picture):
    """Where the picture is not background."""
    return picture.min(axis=2) < 0.99


def gray(colors):
    return np.ptp(colors, axis=-1) < 0.05


@pytest.mark.parametrize("dtypes", [(np.float64, np.int64), (np.float32, np.int32), (np.float64, np.uint32)])
def test_a_sphere_fills_the_picture_as_computed(offscreen, tmp_path, dtypes):
    x, f = sphere()
    viz.render_mesh(tmp_path / "a.png", x.astype(dtypes[0]), f.astype(dtypes[1]), size=SIZE)
    picture = read(tmp_path / "a.png")
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    shown = drawn(picture)
    assert abs(shown.mean() - DISK) < 0.02
    rows, columns = np.nonzero(shown)
    assert abs(rows.mean() - (SIZE[1] - 1) / 2) < 2 and abs(columns.mean() - (SIZE[0] - 1) / 2) < 2
    assert gray(picture).all() and picture[shown].std() > 0.05


def test_field_colors_follow_the_speed_and_the_color_bar(offscreen, tmp_path):
    x, f = sphere(4000)
    viz.render_field(tmp_path / "a.png", x, f, about_z(x), size=SIZE, view=SIDE, arrows=0)
    picture = read(tmp_path / "a.png")
    for row in (20, 40, 70, 119, 170, 200, 220):
        pixel = picture[row, SIZE[0] // 2] ** 2.2
        expected = np.array(color_map(SPEED_MAP)(speed_in_row(row)))[:3] ** 2.2
        np.testing.assert_allclose(pixel / pixel.sum(), expected / expected.sum(), atol=0.015)
    viz.render_field(tmp_path / "b.png", x, f, x, size=SIZE, view=SIDE, arrows=0)
    brightest = read(tmp_path / "b.png")[60:180, 100:220].max(axis=(0, 1))
    np.testing.assert_allclose(brightest, color_map(SPEED_MAP)(1.0)[:3], atol=0.02)


def test_arrows_are_dark_and_can_be_left_out(offscreen, tmp_path):
    x, f = sphere()
    dark = []
    for arrows in (0, 60, 200):
        viz.render_field(tmp_path / "a.png", x, f, about_z(x), size=SIZE, arrows=arrows)
        dark.append((read(tmp_path / "a.png").max(axis=2) < 0.2).mean())
    assert dark[0] == 0 and 0.005 < dark[1] < 0.2 and 0.005 < dark[2] < 0.2
    viz.render_field(tmp_path / "a.png", x, f, np.zeros_like(x), size=SIZE)
    assert drawn(read(tmp_path / "a.png")).mean() > 0.4


def test_arrow_lengths_are_proportional_to_the_norm():
    x, f = sphere(4000)
    samples = spread_evenly(x, f, 300)
    (arrows,) = arrows_at(samples, x, f, about_z(x), eye=np.array([9.0, 0, 0]))
    rings = arrows.vertices.reshape(-1, 5, 10, 3)
    tails, tips = rings[:, 0].mean(axis=1), rings[:, 4].mean(axis=1)
    middles = (tails + tips) / 2
    assert 60 < len(middles) < 150 and (middles[:, 0] > 0).all(), "only arrows that the camera can see"
    speeds = np.linalg.norm(middles[:, :2], axis=1) / np.linalg.norm(middles, axis=1)
    expected = REACH * samples.spacing * speeds
    np.testing.assert_allclose(np.linalg.norm(tips - tails, axis=1), expected, rtol=0.02, atol=1e-3)
    directions = np.cross([0.0, 0.0, 1.0], middles)
    assert ((tips - tails) * directions).sum(axis=1).min() > 0


def test_samples_are_even_on_uneven_triangles_and_on_both_sides_of_a_wing():
    x, f = sphere(2000)
    dense = np.concatenate(
        [x, 0.3 * x[:, [1, 2, 0]]]
    )  # a second, denser sphere with the same number of faces
    faces = np.concatenate([f, f + len(x)])
    samples = spread_evenly(dense, faces, 400)
    places = (samples.weights[:, :, None] * dense[faces[samples.faces]]).sum(axis=1)
    nearest = cKDTree(places).query(places, k=2)[0][:, 1]
    assert nearest.min() > 0.55 * samples.spacing and nearest.max() < 1.5 * samples.spacing
    inner = (np.linalg.norm(places, axis=1) < 0.5).mean()
    assert abs(inner - 0.09 / 1.09) < 0.02
    wing = x * [1.0, 1.0, 0.002]
    samples = spread_evenly(wing, f, 200)
    assert abs((x[f[samples.faces]].mean(axis=1)[:, 2] > 0).mean() - 0.5) < 0.04
    again = spread_evenly(wing, f, 200)
    np.testing.assert_array_equal(again.weights, samples.weights)


@pytest.mark.parametrize("size", [(300, 100), (100, 300), (200, 200)])
def test_camera_sees_all_points_and_no_nearer_one_does(size):
    points = np.random.default_rng(2).normal(size=(200, 3)) * [3.0, 1.0, 0.2]
    camera = fit_camera(points, size, ((1.0, 2.0, 3.0), (0.1, 1.0, 0.0)))
    back = (camera.position - camera.target) / np.linalg.norm(camera.position - camera.target)
    right = np.cross(camera.up, back)
    depth = (camera.position - points) @ back
    slope = np.tan(np.radians(14)) * depth
    across = (points - camera.position) @ right / slope * size[1] / size[0]
    along = (points - camera.position) @ camera.up / slope
    assert max(np.abs(across).max(), np.abs(along).max()) == pytest.approx(1 - MARGIN, abs=0.01)
    for side in (across, along):
        assert side.max() == pytest.approx(-side.min(), abs=1e-6)


@pytest.mark.parametrize(("shift", "scale"), [(1e6, 1.0), (0.0, 1e-6), (-3.0, 1e8)])
def test_place_and_size_of_the_mesh_do_not_matter(offscreen, tmp_path, shift, scale):
    x, f = annulus()
    viz.render_field(tmp_path / "a.png", x, f, about_z(x), size=SIZE)
    viz.render_field(tmp_path / "b.png", scale * x + shift, f, about_z(x), size=SIZE)
    assert np.abs(read(tmp_path / "a.png") - read(tmp_path / "b.png")).mean() < 2e-3


def test_both_sides_of_an_open_surface_look_the_same(offscreen, tmp_path):
    x, f = annulus()
    shown = []
    for name, z in (("a", 1.0), ("b", -1.0)):
        viz.render_field(
            tmp_path / f"{name}.png", x, f, about_z(x), size=SIZE, view=((0.0, 0.0, z), (0.0, 1.0, 0.0))
        )
        picture = read(tmp_path / f"{name}.png")
        shown.append(picture[drawn(picture)])
        assert not drawn(picture)[SIZE[1] // 2, SIZE[0] // 2], "the hole is open"
    np.testing.assert_allclose(shown[0].mean(axis=0), shown[1].mean(axis=0), atol=0.02)
    assert shown[0].mean() > 0.4, "lit, not in shadow"


def test_pictures_repeat_whatever_was_drawn_in_between(offscreen, tmp_path):
    x, f = sphere()
    viz.render_field(tmp_path / "a.png", x, f, about_z(x), size=SIZE)
    ring, g = annulus()
    viz.render_mesh(tmp_path / "b.png", ring, g, size=(200, 300), view=viz.Z_UP, smooth=False)
    viz.render_before_after(tmp_path / "b.png", ring, 1.1 * ring, g, vectors_after=about_z(ring))
    viz.render_field(tmp_path / "c.png", x, f, about_z(x), size=SIZE)
    different = (np.abs(read(tmp_path / "a.png") - read(tmp_path / "c.png")) > 2 / 255).any(axis=2)
    # A setting left over would change a surface; the renderer's rounding moves single samples on outlines.
    assert different.mean() < 1e-4


def test_a_strip_has_every_field_and_its_caption(offscreen, tmp_path):
    x, f = sphere()
    fields = np.stack([np.cross(axis, x) for axis in np.eye(3)])
    viz.render_fields(
        tmp_path / "a.png", x, f, fields, [f"λ{i}·Area = 1.2e-7" for i in "₀₁₂"], size=(600, 230)
    )
    viz.render_fields(tmp_path / "b.png", x, f, fields, size=(600, 230))
    titled, bare = read(tmp_path / "a.png"), read(tmp_path / "b.png")
    assert titled.shape == bare.shape == (230, 600, 3)
    for panel in np.split(titled, 3, axis=1):
        assert 0.3 < drawn(panel[22:]).mean() < 0.75
        assert 0.02 < drawn(panel[:22]).mean() < 0.4, "caption"
    panels = np.split(bare, 3, axis=1)
    assert np.abs(panels[0] - panels[1]).mean() > 0.02, "different fields"
    assert np.abs(drawn(panels[0]).mean() - drawn(panels[1]).mean()) < 0.01, "one camera"


def test_before_and_after(offscreen, tmp_path):
    x, f = sphere()
    after = x * (1 + 0.05 * x[:, 2:])
    path = tmp_path / "a.png"
    viz.render_before_after(path, x, after, f, view=SIDE, size=(640, 280))
    picture = read(path)
    assert picture.shape == (280, 640, 3)
    before, moved = picture[20:, :290], picture[20:, 290:580]
    assert gray(before).all() and 0.3 < drawn(before).mean() < 0.8
    upper, lower = moved[60:90, 120:170].mean(axis=(0, 1)), moved[170:200, 120:170].mean(axis=(0, 1))
    assert upper[0] > upper[2] + 0.1 and lower[2] > lower[0] + 0.1, "red outward above, blue inward below"
    bar = picture[20:, 580:600]
    assert (bar[..., 0] > bar[..., 2] + 0.3).any() and (bar[..., 2] > bar[..., 0] + 0.3).any()
    viz.render_before_after(
        path,
        x,
        after,
        f,
        quantity="size",
        unit=0.01,
        unit_name="cm",
        vectors_before=about_z(x),
        size=(640, 280),
    )
    picture = read(path)
    dark = picture.max(axis=2) < 0.2
    assert dark[30:, :290].mean() > 0.01 and dark[30:, 290:580].mean() < 0.01, "arrows on the first only"
    viz.render_before_after(path, x, x, f, size=(640, 280))  # nothing moved
    assert gray(read(path)[30:, 290:570]).all()


def test_displacement_is_signed_and_counts_in_its_unit():
    x, f = sphere(2000)
    np.testing.assert_allclose(displacement(x, 1.1 * x, f, "normal"), 0.1, rtol=0.01)
    np.testing.assert_allclose(displacement(x, 0.9 * x, f, "normal"), -0.1, rtol=0.01)
    np.testing.assert_allclose(displacement(x, 0.9 * x, f, "size"), 0.1)
    np.testing.assert_allclose((vertex_normals(x, f) * x).sum(axis=1), 1, atol=0.01)
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert mean_edge_length(square, np.array([[0, 1, 2], [0, 2, 3]])) == pytest.approx((4 + 2**0.5) / 5)
    assert color_limits(np.zeros(5), signed=True) == ((-1.0, 1.0), "neither")
    assert color_limits(np.full(5, -2.0), signed=True) == ((-2.0, 2.0), "neither")
    (low, high), clipped = color_limits(np.append(np.linspace(0, 1, 999), 50.0), signed=False)
    assert low == 0 and 0.99 < high < 1.0 and clipped == "max"
    assert color_limits(np.append(np.zeros(999), 3.0), signed=False) == ((0.0, 3.0), "neither")


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
        ("parallel", {"view": ((0.0, 1.0, 0.0), (0.0, 2.0, 0.0))}),
        ("finite numbers", {"view": ((0.0, 1.0), (0.0, 2.0, 0.0))}),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, message, changes):
    given = {"path": "a.png", "vertices": X, "faces": F, "vectors": about_z(X), "size": SIZE, "arrows": 5}
    given |= changes
    given["path"] = tmp_path / given["path"]
    with pytest.raises(ValueError, match=message):
        viz.render_field(**given)
    assert list(tmp_path.iterdir()) == []


def test_what_pages_refuse(tmp_path):
    path = tmp_path / "a.png"
    with pytest.raises(ValueError, match="2 captions for 1 fields"):
        viz.render_fields(path, X, F, X[None], ["a", "b"])
    with pytest.raises(ValueError, match="k ≥ 1"):
        viz.render_fields(path, X, F, np.zeros((0, 60, 3)))
    with pytest.raises(ValueError, match=r"vectors\[1\] must be finite; row 0"):
        viz.render_fields(path, X, F, np.stack([X, X * np.nan]))
    for unit in (0.0, float("nan")):
        with pytest.raises(ValueError, match="positive length"):
            viz.render_before_after(path, X, X, F, unit=unit)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        viz.render_mesh(tmp_path / "nowhere" / "a.png", X, F)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_no_scene_and_keeps_the_old_file(offscreen, tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(*args, **kwargs):
        raise OSError("no room")

    with monkeypatch.context() as patch:
        patch.setattr(offscreen, "screenshot_to_buffer", fail)
        with pytest.raises(OSError, match="no room"):
            viz.render_mesh(path, X, F, size=SIZE)
    assert not offscreen.has_surface_mesh("surface 0")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail)
        with pytest.raises(OSError, match="no room"):
            viz.render_mesh(path, X, F, size=SIZE)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]
    viz.render_mesh(path, X, F, size=SIZE)
    assert drawn(read(path)).any() and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("module", ["polyscope", "matplotlib"])
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, module):
    monkeypatch.setattr(_session, "missing_libraries", list)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf'needs {module}: pip install "jaxkvf\[viz\]"'):
        viz.render_field(tmp_path / "a.png", X, F, X, size=SIZE)
    assert list(tmp_path.iterdir()) == []


def test_missing_system_libraries_are_named_before_polyscope_starts(tmp_path, monkeypatch):
    def absent(name, *args, **kwargs):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", absent)
    monkeypatch.setattr(_session, "_started_by", None)
    with pytest.raises(RuntimeError, match=r"libX11.so.6, libEGL.so.1, libGL.so.1: run .ci/system-packages"):
        viz.render_mesh(tmp_path / "a.png", X, F, size=SIZE)
    assert list(tmp_path.iterdir()) == []


def test_another_thread_is_told_so(offscreen, tmp_path):
    errors = []

    def render():
        try:
            viz.render_mesh(tmp_path / "a.png", X, F, size=SIZE)
        except RuntimeError as error:
            errors.append(str(error))

    thread = threading.Thread(target=render)
    thread.start()
    thread.join()
    assert len(errors) == 1 and "another thread" in errors[0]


def test_the_callers_matplotlib_style_neither_changes_nor_shows(offscreen, tmp_path):
    import matplotlib as mpl  # noqa: PLC0415  only where pictures are made

    def strip(name):
        viz.render_fields(tmp_path / name, X, F, X[None], ["caption"], size=(200, 200), arrows=0)
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
        viz.render_field(name, x, f, x, size=(100, 100))
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
