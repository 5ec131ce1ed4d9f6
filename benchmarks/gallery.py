"""The gallery of the documentation: renders docs/gallery/*.png and writes docs/gallery.md, with the numbers in it.

python benchmarks/gallery.py   (needs chromium, for the picture of a report)
"""

import io
import subprocess
import sys
import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

import jaxkvf  # noqa: E402
from jaxkvf import KillingFields, TriangleMesh, geometry, patterns, report, shapes, viz  # noqa: E402
from jaxkvf.files import write_whole  # noqa: E402

DOCS = Path(__file__).resolve().parents[1] / "docs"
LARGEST = 120_000  # bytes a picture


def arrays(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def field_scenes(mesh: TriangleMesh, found: KillingFields) -> list[viz.Scene]:
    titles = [f"λ·area = {value:.3g}" for value in np.asarray(found.dimensionless)]
    vectors = np.asarray(found.vectors)
    return [
        viz.Scene(*arrays(mesh), title, vectors=field) for title, field in zip(titles, vectors, strict=True)
    ]


def listed(values: object) -> str:
    return ", ".join(f"{value:.3g}" for value in np.asarray(values))


def limbs(path: Path) -> str:
    mesh = shapes.limbed_blob(20)
    found = jaxkvf.killing_fields(mesh, 4)
    viz.render(path, field_scenes(mesh, found), size=(1280, 340))
    return (
        "A blob with limbs, no symmetry, and the fields closest to one: they turn the limbs as far as the rest lets them. "
        f"λ·area = {listed(found.dimensionless)}. `killing_fields`, `viz.render`; Fig. 11 of the paper."
    )


def cone(path: Path) -> str:
    mesh = shapes.squashed_cone(0.8, 40)
    found = jaxkvf.killing_fields(mesh, 1)
    field = found.vectors[0]
    turn = jaxkvf.period(mesh, field)
    along = np.linspace(0.12, 0.9, 12)
    slant = along[:, None] * np.array([0.0, 1.0, 1.0])
    cap = np.stack([0 * along, 0 * along + 1, along], axis=1)[1::2]
    starts = jaxkvf.closest_points(mesh, np.concatenate([slant, cap]))
    curves = jaxkvf.integral_curves(mesh, field, turn.period, starts)
    scene = viz.Scene(*arrays(mesh), vectors=np.asarray(field), curves=curves.polylines())
    viz.render(path, scene, size=(900, 640))
    return (
        f"A cone squashed to 0.8 of its width keeps a symmetry roughly, λ₀·area = {float(found.dimensionless[0]):.3g}: "
        f"{int(turn.closed.sum())} of {len(turn.closed)} integral curves close, their times spread by {turn.spread:.1%}. "
        "`period`, `integral_curves`, `viz.render`; Fig. 8."
    )


def symmetrized(path: Path) -> str:
    round_one = shapes.ellipsoid(16)
    x = np.asarray(round_one.vertices)
    dent = 0.25 * np.exp(-(((x - [0.8, -0.5, 0.5]) / 0.45) ** 2).sum(axis=1))
    mesh = round_one.with_vertices(jnp.asarray(x * (1 - dent[:, None] * [1, 1, 0])))
    done = jaxkvf.symmetrize(mesh)
    account = jaxkvf.symmetry_report(mesh, done)
    before, after = (jaxkvf.killing_fields(m, 1) for m in (mesh, done.mesh))
    unit = geometry.mean_edge_length(geometry.edge_lengths(mesh.vertices, mesh.topology))
    moved = geometry.normal_displacements(mesh.vertices, done.mesh.vertices, mesh.topology) / unit
    bar = {"values": np.asarray(moved), "signed": True, "color_bar": "normal displacement / mean edge length"}
    scenes = [
        viz.Scene(*arrays(mesh), "before", vectors=np.asarray(before.vectors[0])),
        viz.Scene(*arrays(done.mesh), "after", vectors=np.asarray(after.vectors[0]), **bar),
    ]
    viz.render(path, scenes, view=viz.Z_UP, size=(1280, 640))
    return (
        f"A spheroid with a dent, λ₀·area = {float(before.dimensionless[0]):.3g}, and the symmetric mesh that `symmetrize` "
        f"finds, {float(after.dimensionless[0]):.2g}, in {account.steps} steps. Vertices moved by "
        f"{account.rms_displacement:.2f} mean edges (RMS), most of it to fill the dent. `viz.render`."
    )


def disks(path: Path) -> str:
    mesh = shapes.vase(72)
    field = jaxkvf.killing_fields(mesh, 1).vectors[0]
    x = np.asarray(mesh.vertices)
    outer = np.hypot(x[:, 0], x[:, 1])
    belly, neck = int(outer.argmax()), int((np.abs(x[:, 2] - 1.75) + (outer < 0.2)).argmin())
    m = 8
    made = jaxkvf.pattern(mesh, field, np.array([belly, neck]), m)
    axis = np.linspace(-1, 1, 256)
    ring = np.hypot(axis[:, None], axis[None, :]) % 0.5 < 0.25
    image = np.where(ring[..., None], [0.19, 0.41, 0.56], [0.96, 0.92, 0.80])
    texture = viz.Texture(*patterns.texture_coordinates(made), patterns.texture(image))
    viz.render(path, viz.Scene(*arrays(made.mesh), texture=texture), view=viz.Z_UP, size=(900, 640))
    return (
        f"Rings around two points of a vase, repeated {m} times by the flow of its Killing field. `pattern`, "
        "`viz.render`; Fig. 14."
    )


def local(path: Path) -> str:
    mesh = shapes.limbed_blob(20)
    radius = 0.8
    values = np.log10(jaxkvf.local_symmetry(mesh, radius, samples=150).values)
    low, high = float(values.min()), float(values.max())
    scene = viz.Scene(
        *arrays(mesh), values=values, limits=(low, high), color_bar="log₁₀ of the lowest λ·area"
    )
    viz.render(path, scene, size=(900, 640))
    return (
        f"Where the blob has symmetric parts: the lowest λ·area of geodesic balls of radius {radius:g} around each place, "
        f"from {10**low:.2g} (dark) to {10**high:.2g} (yellow), on a logarithmic scale. `local_symmetry`."
    )


def bent(path: Path) -> str:
    flat = shapes.annulus(12, 0.4, 1.0)
    mesh = flat.with_vertices(flat.vertices.at[:, 2].set(0.6 * flat.vertices[:, 0] ** 2))
    found = jaxkvf.killing_fields(mesh, 4)
    view = ((0.5, -1.0, 0.9), (0.0, 0.0, 1.0))
    viz.render(path, field_scenes(mesh, found), view=view, size=(1280, 340))
    return (
        "A flat piece bent into a trough, with free boundary. No motion of space takes it into itself, but lengths on it "
        f"are as they were: it has the three Killing fields of the plane: λ·area = {listed(found.dimensionless)}. "
        "`killing_fields`; Fig. 2 and §3.4."
    )


def page(path: Path) -> str:
    mesh = shapes.add_normal_noise(shapes.vase(), 0.05, seed=0)
    done = jaxkvf.symmetrize(mesh)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "vase.html"
        report.write_report(file, mesh, symmetrized=done.mesh, title="A noisy vase")
        size = file.stat().st_size
        command = (
            "chromium --headless --no-sandbox --disable-gpu --use-angle=swiftshader --enable-unsafe-swiftshader "
            "--no-first-run --disable-background-networking --disable-component-update --disable-sync "
            f"--user-data-dir={folder}/profile --window-size=1280,720 --virtual-time-budget=4000 --screenshot={path} {file}"
        )
        subprocess.run(command.split(), check=True, capture_output=True, timeout=120)
    return (
        f"`jaxkvf report MESH -o vase.html --symmetrize`: a noisy vase of {mesh.topology.n_vertices:,} vertices and the "
        f"symmetrized one, in one page of {size / 1e6:.1f} MB. [HTML reports](report.md)."
    )


PICTURES = {
    "Limbs": limbs,
    "A squashed cone": cone,
    "Symmetrized": symmetrized,
    "A pattern": disks,
    "Local symmetry": local,
    "Bent, and flat": bent,
    "A report": page,
}


def small(path: Path) -> None:
    """Fewer colours until the file is small."""
    picture = Image.open(path).convert("RGB")
    for colors in (256, 128, 64, 32):
        content = io.BytesIO()
        picture.quantize(colors, dither=Image.Dither.NONE).save(content, format="PNG", optimize=True)
        if len(content.getvalue()) <= LARGEST:
            write_whole(path, content.getvalue())
            return
    sys.exit(f"{path.name} does not fit into {LARGEST:,} bytes")


def main() -> None:
    page = "# Gallery\n\nPictures and numbers are made by `python benchmarks/gallery.py`, which writes this page.\n"
    for title, draw in PICTURES.items():
        path = DOCS / "gallery" / f"{draw.__name__}.png"
        caption = draw(path)
        small(path)
        print(f"{path.name}: {path.stat().st_size:,} bytes. {caption}", flush=True)
        page += f"\n## {title}\n\n![{title}](gallery/{path.name})\n\n{caption}\n"
    write_whole(DOCS / "gallery.md", page.encode())


if __name__ == "__main__":
    main()
