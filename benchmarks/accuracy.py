"""Accuracy against exact spectra: the table in README.

python benchmarks/accuracy.py
"""

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import jaxkvf  # noqa: E402
from jaxkvf import reference, shapes  # noqa: E402


def relative_l2(values: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(values - exact) / np.linalg.norm(exact))


PAPER = jaxkvf.killing.Dec(curvature="edge")


def lowest(
    mesh: jaxkvf.TriangleMesh, k: int, discretization: str | jaxkvf.killing.AbstractDiscretization
) -> np.ndarray:
    return np.asarray(jaxkvf.killing_eigenvalues(mesh, k, discretization=discretization))


def main() -> None:
    sphere_20k, sphere_10k, spheroid = shapes.icosphere(45), shapes.icosphere(32), shapes.ellipsoid(32)
    coarse = shapes.icosphere(16)
    spheroid_exact = reference.surface_of_revolution_spectrum(np.sin, lambda t: 1.6 * np.cos(t), 20)
    bad = shapes.random_sphere(10_242, seed=1, radii=(1.0, 1.0, 2.5))
    bad_exact = reference.surface_of_revolution_spectrum(np.sin, lambda t: 2.5 * np.cos(t), 10)
    print("| | the paper's operator | `dec` | `regge` | `regge-delaunay` |")
    print("| --- | --- | --- | --- | --- |")

    def row(what: str, measure) -> None:
        print(
            f"| {what} | {' | '.join(measure(d) for d in (PAPER, 'dec', 'regge', 'regge-delaunay'))} |",
            flush=True,
        )

    row(
        "sphere, 20,252 vertices, 180 eigenvalues, relative l2 error (paper: 0.0016)",
        lambda d: f"{relative_l2(lowest(sphere_20k, 180, d), reference.sphere_spectrum(180)):.5f}",
    )
    row("sphere, 10,242 vertices, λ₀ (exact: 0)", lambda d: f"{lowest(sphere_10k, 3, d)[0]:.1e}")
    row(
        "order of λ₀ in h, 2,562 → 10,242 vertices",
        lambda d: f"{np.log2(lowest(coarse, 1, d)[0] / lowest(sphere_10k, 1, d)[0]):.2f}",
    )
    row(
        "spheroid 1 : 1 : 1.6, 10,242 vertices, 20 eigenvalues, relative l2 error",
        lambda d: f"{relative_l2(lowest(spheroid, 20, d), spheroid_exact):.1e}",
    )
    row(
        "spheroid 1 : 1 : 2.5, 10,242 random vertices, 17 % of the edges not Delaunay, 10 eigenvalues, relative l2 error",
        lambda d: f"{relative_l2(lowest(bad, 10, d), bad_exact):.1e}",
    )


if __name__ == "__main__":
    main()
