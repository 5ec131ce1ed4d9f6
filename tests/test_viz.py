"""Pictures of one mesh: the object in them, where it should be, in the right colours."""

import numpy as np
import pytest
from jaxtyping import install_import_hook
from pictures import about_z, annulus, drawn, gray, read, sphere
from scipy import ndimage
from scipy.spatial import ConvexHull

from jaxkvf.geometry import spread_evenly

with install_import_hook("jaxkvf", "beartype.beartype"):  # jaxkvf itself does not import jaxkvf.viz
    from jaxkvf import viz
    from jaxkvf.viz._arrows import REACH, arrows_at
    from jaxkvf.viz._camera import FIELD_OF_VIEW, MARGIN, fit_camera
    from jaxkvf.viz._colors import SPEED_MAP, color_map
    from jaxkvf.viz._pictures import ARROW_PIXELS

SIZE = (320, 240)
SIDE = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""From the side: the axis of revolution z is upright in the middle."""
DISK = np.pi * ((1 - MARGIN) * SIZE[1] / 2) ** 2 / (SIZE[0] * SIZE[1])
"""Share of the picture that a sphere fills."""


def speed_in_row(row):
    """Distance from the axis of the unit sphere's point in the middle column, seen from the `SIDE`."""
    half = np.tan(np.radians(FIELD_OF_VIEW) / 2)
    distance = 1 / np.sin(np.arctan((1 - MARGIN) * half))
    angle = np.arctan((1 - (2 * row + 1) / SIZE[1]) * half)
    along = distance * np.cos(angle) - np.sqrt(1 - (distance * np.sin(angle)) ** 2)
    return np.sqrt(1 - (along * np.sin(angle)) ** 2)


@pytest.mark.parametrize("dtypes", [(np.float64, np.int64), (np.float32, np.int32), (np.float64, np.uint32)])
def test_a_sphere_fills_the_picture_as_computed(offscreen, tmp_path, dtypes):
    x, f = sphere()
    viz.render(tmp_path / "a.png", viz.Scene(x.astype(dtypes[0]), f.astype(dtypes[1])), size=SIZE)
    picture = read(tmp_path / "a.png")
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    shown = drawn(picture)
    assert abs(shown.mean() - DISK) < 0.02
    rows, columns = np.nonzero(shown)
    assert abs(rows.mean() - (SIZE[1] - 1) / 2) < 2 and abs(columns.mean() - (SIZE[0] - 1) / 2) < 2
    assert gray(picture).all() and picture[shown].std() > 0.05


def test_field_colors_follow_the_speed_and_the_color_bar(offscreen, tmp_path):
    x, f = sphere(4000)
    viz.render(tmp_path / "a.png", viz.Scene(x, f, vectors=about_z(x), arrows=0), size=SIZE, view=SIDE)
    picture = read(tmp_path / "a.png")
    for row in (20, 40, 70, 119, 170, 200, 220):
        pixel = picture[row, SIZE[0] // 2] ** 2.2
        expected = np.array(color_map(SPEED_MAP)(speed_in_row(row)))[:3] ** 2.2
        np.testing.assert_allclose(pixel / pixel.sum(), expected / expected.sum(), atol=0.015)
    viz.render(tmp_path / "b.png", viz.Scene(x, f, vectors=x, arrows=0), size=SIZE, view=SIDE)
    brightest = read(tmp_path / "b.png")[60:180, 100:220].max(axis=(0, 1))
    np.testing.assert_allclose(brightest, color_map(SPEED_MAP)(1.0)[:3], atol=0.02)


def test_arrows_are_dark_and_can_be_left_out(offscreen, tmp_path):
    x, f = sphere()
    dark = []
    for arrows in (0, 60, 200):
        viz.render(tmp_path / "a.png", viz.Scene(x, f, vectors=about_z(x), arrows=arrows), size=SIZE)
        dark.append((read(tmp_path / "a.png").max(axis=2) < 0.2).mean())
    assert dark[0] == 0 and 0.005 < dark[1] < 0.2 and 0.005 < dark[2] < 0.2
    viz.render(tmp_path / "a.png", viz.Scene(x, f, vectors=np.zeros_like(x)), size=SIZE)
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
    viz.render(tmp_path / "a.png", viz.Scene(x, f, vectors=about_z(x)), size=SIZE)
    viz.render(tmp_path / "b.png", viz.Scene(scale * x + shift, f, vectors=about_z(x)), size=SIZE)
    assert np.abs(read(tmp_path / "a.png") - read(tmp_path / "b.png")).mean() < 2e-3


def test_both_sides_of_an_open_surface_look_the_same(offscreen, tmp_path):
    x, f = annulus()
    shown = []
    for name, z in (("a", 1.0), ("b", -1.0)):
        viz.render(
            tmp_path / f"{name}.png",
            viz.Scene(x, f, vectors=about_z(x)),
            size=SIZE,
            view=((0.0, 0.0, z), (0.0, 1.0, 0.0)),
        )
        picture = read(tmp_path / f"{name}.png")
        shown.append(picture[drawn(picture)])
        assert not drawn(picture)[SIZE[1] // 2, SIZE[0] // 2], "the hole is open"
    np.testing.assert_allclose(shown[0].mean(axis=0), shown[1].mean(axis=0), atol=0.02)
    assert shown[0].mean() > 0.4, "lit, not in shadow"


def test_pictures_repeat_whatever_was_drawn_in_between(offscreen, tmp_path):
    x, f = sphere()
    viz.render(tmp_path / "a.png", viz.Scene(x, f, vectors=about_z(x)), size=SIZE)
    ring, g = annulus()
    viz.render(tmp_path / "b.png", viz.Scene(ring, g, crease_angle=0.0), size=(200, 300), view=viz.Z_UP)
    scenes = [
        viz.Scene(ring, g, "a"),
        viz.Scene(1.1 * ring, g, values=ring[:, 0], signed=True, color_bar="x"),
    ]
    viz.render(tmp_path / "b.png", scenes)
    viz.render(tmp_path / "c.png", viz.Scene(x, f, vectors=about_z(x)), size=SIZE)
    different = (np.abs(read(tmp_path / "a.png") - read(tmp_path / "c.png")) > 2 / 255).any(axis=2)
    # A setting left over would change a surface; the renderer's rounding moves single samples on outlines.
    assert different.mean() < 1e-4


def test_arrows_can_be_told_apart_at_the_size_of_the_picture(offscreen, tmp_path):
    """As the picture gets smaller there are fewer of them, and none gets too small to be seen."""
    x, f = sphere(4000)
    widths = []
    for size in ((200, 200), (800, 800)):
        viz.render(tmp_path / "a.png", viz.Scene(x, f, vectors=about_z(x)), size=size, view=viz.Z_UP)
        dark = read(tmp_path / "a.png").max(axis=2) < 0.2
        heads = [ndimage.binary_opening(dark, np.ones((n, n))).sum() for n in (1, 3, 5)]
        assert heads[2] > 0.05 * heads[0]
        widths.append(heads[0] / dark.size)
    assert 0.4 < widths[0] / widths[1] < 2.5
    spacing = ARROW_PIXELS / (np.pi * 94**2) ** 0.5
    assert 1 / spacing**2 < 15, "arrows on the disk that the small picture shows of the sphere"


def box():
    """The unit cube, two triangles a side."""
    x = np.stack(np.mgrid[0:2, 0:2, 0:2], axis=-1).reshape(-1, 3).astype(float)
    f = ConvexHull(x).simplices.astype(np.int64)
    inward = np.linalg.det((x - 0.5)[f]) < 0
    f[inward] = f[inward, ::-1]
    return x, f


def test_each_side_of_a_box_has_one_shade_and_smooth_shading_many(offscreen, tmp_path):
    x, f = box()
    shades = []
    for angle in (0.0, 40.0, 180.0):
        viz.render(tmp_path / "a.png", viz.Scene(x, f, crease_angle=angle), size=SIZE)
        picture = np.round(255 * read(tmp_path / "a.png")).astype(int)
        _, counts = np.unique(picture[drawn(picture / 255)], axis=0, return_counts=True)
        shades.append((counts > 0.02 * counts.sum()).sum())
    assert shades[0] == shades[1] == 3 and (counts.max() < 0.1 * counts.sum())
    shown = []
    for angle in (40.0, 180.0):  # a smooth surface has no creases
        ball, g = sphere()
        viz.render(tmp_path / "a.png", viz.Scene(ball, g, crease_angle=angle), size=SIZE)
        shown.append(read(tmp_path / "a.png"))
    assert np.abs(shown[0] - shown[1]).max() < 0.01


@pytest.mark.parametrize("axis", [(0, 0, 2), (0, -1, 0), (3, 0, 0), (1, -2, 0.5), (1, 1, 1)])
def test_views_upright(axis):
    axis = np.array(axis, float)
    direction, up = (np.asarray(part) for part in viz.view_upright(axis))
    axis /= np.linalg.norm(axis)
    np.testing.assert_allclose(np.abs(up @ axis), 1)
    assert up[np.argmax(np.abs(up))] > 0
    standard = (viz.X_UP, viz.Y_UP, viz.Z_UP)[int(np.argmax(np.abs(axis)))]
    assert direction @ up == pytest.approx(np.dot(*standard)), "as far above the horizon"
    assert np.linalg.norm(direction) == pytest.approx(np.linalg.norm(standard[0]))
    if np.count_nonzero(axis) == 1:
        np.testing.assert_allclose(direction, standard[0])
