"""Pictures of curves, textures and series: each thing where it belongs. And what notebooks and other libraries get."""

import base64
import io
import sys

import numpy as np
import pytest
from jaxtyping import install_import_hook
from pictures import about_z, arrays, drawn, gray, read, sphere

from jaxkvf import shapes

with install_import_hook("jaxkvf", "beartype.beartype"):  # jaxkvf itself does not import jaxkvf.viz
    from jaxkvf import viz
    from jaxkvf.viz._axes import SERIES_COLORS
    from jaxkvf.viz._color_bar import ColorBar
    from jaxkvf.viz._colors import SIGNED_MAP, SPEED_MAP, ColorScale

SIDE = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
ABOVE = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
SIZE = (240, 240)
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def test_flow_lines_lie_on_the_curve_and_end_in_a_head(offscreen, tmp_path):
    x, f = arrays(shapes.disk(8))
    t = np.linspace(0, 1.5 * np.pi, 60)
    curve = 0.5 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    for vectors in (None, np.cross([0.0, 0, 1], x)):
        scene = viz.Scene(x, f, vectors=vectors, curves=[curve, curve[:1]])
        viz.render(tmp_path / "a.png", scene, size=(400, 400), view=ABOVE)
        picture = read(tmp_path / "a.png")
        rows, columns = np.nonzero(drawn(picture))
        radius, middle = np.ptp(columns) / 2, 199.5
        rows, columns = np.nonzero(picture.max(axis=2) < 0.25)
        dx, dy = (columns - middle) / radius, (middle - rows) / radius
        off, angle = np.hypot(dx, dy) - 0.5, np.degrees(np.arctan2(dy, dx)) % 360
        assert np.abs(off).max() < 0.04
        assert (
            np.histogram(angle, np.arange(2, 269, 10))[0].min() > 10
            and not ((angle > 275) & (angle < 355)).any()
        )
        width = [np.abs(off[(angle > a) & (angle < a + 4)]).max() for a in (100, 258.5)]
        assert width[1] > 1.8 * width[0], "the head"


def test_a_series_has_one_scale_or_each_its_own(offscreen, tmp_path):
    x, f = arrays(shapes.icosphere(8))
    scenes = [
        viz.Scene(x, f, "large"),
        viz.Scene(0.5 * x, f, "small", vectors=x, arrows=0),
        viz.Scene(x, f, "large"),
    ]
    shares = []
    for same_scale in (True, False):
        viz.render(tmp_path / "a.png", scenes, columns=2, size=(400, 480), same_scale=same_scale)
        picture = read(tmp_path / "a.png")
        assert picture.shape == (480, 400, 3)
        panels = [picture[r : r + 210, c : c + 200] for r in (30, 270) for c in (0, 200)]
        shares.append([drawn(panel).mean() for panel in panels])
        assert shares[-1][3] == 0, "an empty place"
        assert all(drawn(picture[r : r + 20, c : c + 200]).any() for r, c in ((0, 0), (0, 200), (240, 0)))
    assert shares[0][1] == pytest.approx(shares[0][0] / 4, rel=0.1) and shares[0][2] == shares[0][0]
    assert shares[1][1] == pytest.approx(shares[1][0], rel=0.02)


def test_a_strip_has_every_field_and_its_caption(offscreen, tmp_path):
    x, f = sphere()
    fields = np.stack([np.cross(axis, x) for axis in np.eye(3)])
    for name, titles in (("a", [f"λ{i}·Area = 1.2e-7" for i in "₀₁₂"]), ("b", [""] * 3)):
        scenes = [viz.Scene(x, f, title, vectors=u) for title, u in zip(titles, fields, strict=True)]
        viz.render(tmp_path / f"{name}.png", scenes, size=(600, 230))
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
    path = tmp_path / "a.png"
    height = {"values": x[:, 2], "signed": True, "color_bar": "z / radius"}
    viz.render(
        path, [viz.Scene(x, f, "before"), viz.Scene(x, f, "after", **height)], view=SIDE, size=(640, 280)
    )
    picture = read(path)
    assert picture.shape == (280, 640, 3)
    before, moved = picture[20:, :290], picture[20:, 290:580]
    assert gray(before).all() and 0.3 < drawn(before).mean() < 0.8
    upper, lower = moved[60:90, 120:170].mean(axis=(0, 1)), moved[170:200, 120:170].mean(axis=(0, 1))
    assert upper[0] > upper[2] + 0.1 and lower[2] > lower[0] + 0.1, "red outward above, blue inward below"
    bar = picture[20:, 580:600]
    assert (bar[..., 0] > bar[..., 2] + 0.3).any() and (bar[..., 2] > bar[..., 0] + 0.3).any()
    scenes = [
        viz.Scene(x, f, vectors=about_z(x)),
        viz.Scene(x, f, values=0 * x[:, 2], signed=True, color_bar="-"),
    ]
    viz.render(path, scenes, size=(640, 280))
    picture = read(path)
    dark = picture.max(axis=2) < 0.2
    assert dark[30:, :290].mean() > 0.01 and dark[30:, 290:580].mean() < 0.01, "arrows on the first only"
    assert gray(picture[30:, 290:570]).all(), "nothing moved"


@pytest.mark.parametrize(
    ("values", "limits"),
    [
        (1e-17, None),
        (-3.7e12, None),
        (12345.7, (12345.0, 12345.1)),  # all numbers of the bar alike but for their last digits
        (2e-3, None),
    ],
)
@pytest.mark.parametrize(
    "label", ["speed", "a label that goes on and on, longer than the bar, with its unit / mean edge"]
)
def test_numbers_and_labels_of_a_color_bar_are_never_cut_off(offscreen, tmp_path, values, limits, label):
    x, f = sphere(200)
    scenes = [
        viz.Scene(x, f, str(i), values=values * x[:, 2], signed=i > 0, limits=limits, color_bar=label)
        for i in range(2)
    ]
    viz.render(tmp_path / "a.png", scenes, size=(700, 240))
    ink = drawn(read(tmp_path / "a.png"))
    assert not (ink[:, :1].any() or ink[:, -1:].any() or ink[:1].any() or ink[-1:].any())
    bar = ColorBar(ColorScale.of(values * x[:, 2], limits=limits), label)
    assert ("10" in bar.caption) == (limits is None and values != 2e-3)


def test_color_scales():
    assert ColorScale.of(np.zeros(5), signed=True) == ColorScale((-1.0, 1.0), SIGNED_MAP)
    assert ColorScale.of(np.full(5, -2.0), signed=True) == ColorScale((-2.0, 2.0), SIGNED_MAP)
    scale = ColorScale.of(np.append(np.linspace(0, 1, 999), 50.0))
    assert scale.limits[0] == 0 and 0.99 < scale.limits[1] < 1.0 and scale.clipped == "max"
    assert ColorScale.of(np.append(np.zeros(999), 3.0)) == ColorScale((0.0, 3.0), SPEED_MAP)
    assert ColorScale.of(np.arange(5.0), limits=(1.0, 4.0)) == ColorScale((1.0, 4.0), SPEED_MAP, "min")
    assert ColorScale.of(np.arange(5.0), limits=(1.0, 3.0)).clipped == "both"


def test_an_image_lies_the_right_way_up(offscreen, tmp_path):
    image = (
        np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 0]]], np.uint8).repeat(32, 0).repeat(32, 1) * 255
    )
    texture = viz.Texture((SQUARE[:, :2] + 1) / 2, HALVES, image)
    viz.render(tmp_path / "a.png", viz.Scene(SQUARE, HALVES, texture=texture), size=SIZE, view=ABOVE)
    picture = read(tmp_path / "a.png")
    for row, column, channels in ((80, 80, [0]), (80, 160, [1]), (160, 80, [2]), (160, 160, [0, 1])):
        pixel = picture[row, column]
        lit = np.isin(np.arange(3), channels)
        assert (pixel[lit] > 0.7).all() and (pixel[~lit] < 0.1).all(), (row, column, pixel)


def test_a_spectrum_and_a_sweep_show_every_curve(tmp_path):
    pytest.importorskip("matplotlib")
    x = np.linspace(1.0, 2.0, 9)
    exact = np.array([0.0, 0, 0, 4, 4, 4, 8, 8, 8])
    viz.plot_spectrum(tmp_path / "a.png", {"a": exact + 0.1, "b": exact[:5] + 0.2}, exact, size=(700, 500))
    viz.plot_spectrum(tmp_path / "b.png", {"a": exact}, size=(700, 500))
    viz.plot_sweep(
        tmp_path / "c.png", x, {"a": x**2, "b": x**3}, {"c": x}, log_x=True, log_y=True, size=(700, 500)
    )
    for name, count in (("a", 2), ("b", 1), ("c", 2)):
        picture = read(tmp_path / f"{name}.png")
        assert picture.shape == (500, 700, 3)
        for i, color in enumerate(SERIES_COLORS[:3]):
            rgb = np.array([int(color[j : j + 2], 16) / 255 for j in (1, 3, 5)])
            where = np.abs(picture - rgb).max(axis=2) < 0.02
            assert (where.sum() > 20) == (i < count), (name, color)
    rows, columns = np.nonzero(where | (np.abs(picture - [0, 0x72 / 255, 0xB2 / 255]).max(axis=2) < 0.02))
    line = (columns > 120) & (rows > 100)  # without the legend
    line = np.array([(c, rows[line & (columns == c)].mean()) for c in np.unique(columns[line])])
    slope, offset = np.polyfit(*line.T, 1)
    assert slope < 0 and np.abs(line[:, 1] - slope * line[:, 0] - offset).max() < 4, "a power is straight"


def test_notebooks_get_the_smaller_of_two_formats(offscreen):
    from PIL import Image  # noqa: PLC0415  only where pictures are made

    x, f = arrays(shapes.icosphere(8))
    for shown, kind in (
        (viz.show(viz.render, viz.Scene(x, f), size=SIZE), "image/jpeg"),
        (viz.show(viz.plot_sweep, np.arange(5.0), {"x": np.arange(5.0)}, size=SIZE), "image/png"),
    ):
        ((found, content),) = shown._repr_mimebundle_().items()
        data = base64.b64decode(content)
        assert found == kind and len(data) <= len(shown.png)
        assert Image.open(io.BytesIO(data)).size == Image.open(io.BytesIO(shown.png)).size == SIZE


@pytest.mark.parametrize("library", ["trimesh", "pyvista"])
def test_other_libraries_get_the_mesh_and_its_arrays(library):
    pytest.importorskip(library)
    x, f = arrays(shapes.torus(16, 8))
    data = {"field": np.cross([0.0, 0, 1], x), "height": x[:, 2]}
    if library == "trimesh":
        theirs = viz.to_trimesh(x, f, data)
        faces, attached = theirs.faces, theirs.vertex_attributes
        assert theirs.is_watertight
    else:
        theirs = viz.to_pyvista(x, f, data)
        faces, attached = theirs.regular_faces, theirs.point_data
    a, b, c = np.moveaxis(x[f], 1, 0)
    assert theirs.area == pytest.approx(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    np.testing.assert_array_equal(faces, f)
    for name, values in data.items():
        np.testing.assert_array_equal(attached[name], values)


@pytest.mark.parametrize(("package", "adapter"), [("pyvista", viz.to_pyvista), ("trimesh", viz.to_trimesh)])
def test_a_missing_library_is_named(monkeypatch, package, adapter):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"needs {package}: pip install"):
        adapter(SQUARE, HALVES)


def test_what_cannot_be_shown_is_refused(tmp_path):
    path, ones = tmp_path / "a.png", np.ones(4)
    place, image = SQUARE[:, :2], np.zeros((2, 2, 3))
    for message, shown in (
        (r"curves\[1\] must be finite", {"curves": [SQUARE, np.full_like(SQUARE, np.inf)]}),
        ("within 0…1; got", {"colors": SQUARE}),
        ("there are 4", {"texture": viz.Texture(place, HALVES + 9, image)}),
        ("image must be", {"texture": viz.Texture(place, HALVES, 2 + image)}),
        ("corners must be", {"texture": viz.Texture(place, HALVES[:1], image)}),
    ):
        with pytest.raises(ValueError, match=message):
            viz.render(path, viz.Scene(SQUARE, HALVES, **shown))
    for message, draw, arguments in (
        ("no scene", viz.render, ([],)),
        ("the reference has 2", viz.plot_spectrum, ({"a": ones}, ones[:2])),
        ("'a' must be a finite", viz.plot_spectrum, ({"a": ones * np.nan},)),
        ("1 … 6 curves", viz.plot_sweep, (ones, {})),
        ("'b' must have 4 values", viz.plot_sweep, (ones, {"b": ones[:3]})),
        ("must end in .png", lambda p, x: viz.plot_sweep(p.with_suffix(".svg"), x, {"a": x}), (ones,)),
    ):
        with pytest.raises(ValueError, match=message):
            draw(path, *arguments)
    with pytest.raises(ValueError, match="columns must be an integer of at least 1"):
        viz.render(path, [viz.Scene(SQUARE, HALVES)], columns=0)
    for adapter in (viz.to_pyvista, viz.to_trimesh):
        with pytest.raises(ValueError, match="'u' must have one row per vertex: 4"):
            adapter(SQUARE, HALVES, {"u": ones[:3]})
    assert list(tmp_path.iterdir()) == []
