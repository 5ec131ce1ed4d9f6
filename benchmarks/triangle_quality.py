"""Accuracy against triangle quality: caps of 10° … 0.01° on a spheroid, against its reference spectrum.

python benchmarks/triangle_quality.py [PICTURE.png]

Every fifth face of a good mesh of the spheroid 1 : 1 : 1.6 is split at a point so near the middle of its first side that the
angles there are as given. The surface stays the same; only its triangles get bad. Prints the table of docs/any-mesh.md.
"""

import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import jaxkvf  # noqa: E402
from jaxkvf import reference, shapes  # noqa: E402

ANGLES = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01)
DISCRETIZATIONS = ("regge", "regge-delaunay", "dec")
COUNT = 10


def with_caps(mesh: jaxkvf.TriangleMesh, angle: float) -> jaxkvf.TriangleMesh:
    """Every fifth face split in three, the flattest with two angles of `angle` degrees."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    split = np.arange(0, len(faces), 5)
    a, b, c = (vertices[faces[split, corner]] for corner in range(3))
    middle, half = (a + b) / 2, np.linalg.norm(b - a, axis=1, keepdims=True) / 2
    inward = c - middle
    inward -= (inward * (b - a)).sum(axis=1, keepdims=True) * (b - a) / (4 * half**2)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    new = len(vertices) + np.arange(len(split))
    i, j, k = faces[split].T
    parts = [np.stack(part, axis=1) for part in ((i, j, new), (j, k, new), (k, i, new))]
    kept = np.delete(faces, split, axis=0)
    points = middle + half * np.tan(np.radians(angle)) * inward
    return jaxkvf.TriangleMesh.from_arrays(np.concatenate([vertices, points]), np.concatenate([kept, *parts]))


def main() -> None:
    good = shapes.ellipsoid(16)
    exact = reference.surface_of_revolution_spectrum(np.sin, lambda t: 1.6 * np.cos(t), COUNT)
    errors: dict[str, list[float]] = {name: [] for name in DISCRETIZATIONS}
    print("| smallest angle | " + " | ".join(f"`{name}`" for name in DISCRETIZATIONS) + " |")
    print("| --- |" + " --- |" * len(DISCRETIZATIONS))
    for label, mesh in [("none split", good), *((f"{angle:g}°", with_caps(good, angle)) for angle in ANGLES)]:
        row = []
        for name in DISCRETIZATIONS:
            began = time.perf_counter()
            found = jaxkvf.killing_eigenvalues(mesh, COUNT, discretization=name, solver=jaxkvf.ScipyEigsh())
            error = float(np.linalg.norm(np.asarray(found) - exact) / np.linalg.norm(exact))
            row.append(f"{error:.1e}")
            errors[name].append(error)
            print(f"{label} {name}: {time.perf_counter() - began:.1f} s", file=sys.stderr)
        print(f"| {label} | {' | '.join(row)} |", flush=True)
    if len(sys.argv) > 1:
        plot(sys.argv[1], errors)


def plot(path: str, errors: dict[str, list[float]]) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    for name, values in errors.items():
        axes.loglog(ANGLES, values[1:], "o-", label=name)
        axes.axhline(values[0], color="0.8", linewidth=0.8, zorder=0)
    axes.invert_xaxis()
    axes.set_ylim(1e-4, 1e-2)
    axes.set_xlabel("smallest angle / degrees")
    axes.set_ylabel(f"relative l2 error of {COUNT} eigenvalues")
    axes.legend()
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
