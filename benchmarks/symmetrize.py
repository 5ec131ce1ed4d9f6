"""Symmetrization: how far λ₀·area falls, what a step costs, and other drivers of the same objective.

python benchmarks/symmetrize.py floors | noise | shapes | large | drivers
"""

import argparse
import time
from collections.abc import Callable

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scipy.optimize  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

import jaxkvf  # noqa: E402
from jaxkvf import TriangleMesh, geometry, shapes  # noqa: E402
from jaxkvf.symmetrization import OUTCOMES, Configuration, PositionFidelity, ShapeBarrier, symmetry_report  # noqa: E402


def asymmetry(mesh: TriangleMesh, count: int = 1) -> float:
    return float(jaxkvf.killing_fields(mesh, count).dimensionless.sum())


def mean_edge(mesh: TriangleMesh) -> float:
    return float(geometry.edge_lengths(mesh.vertices, mesh.topology).mean())


def bent_tube(n_around: int = 40, n_along: int = 60) -> TriangleMesh:
    """An open tube of radius ½ along 2 radians of a circle of radius 2."""
    straight = shapes.cylinder(n_around, n_along, radius=0.5, height=4.0)
    x, y, z = np.asarray(straight.vertices).T
    angle = z / 2
    bent = np.stack([(2 + x) * np.cos(angle), y, (2 + x) * np.sin(angle)], axis=1)
    return straight.with_vertices(jnp.asarray(bent))


def floors() -> None:
    print("λ₀·area of noise-free surfaces of revolution on meshes without that symmetry, times F²")
    for name, mesh in {
        "sphere, 642 vertices": shapes.icosphere(8),
        "sphere, 2,562": shapes.icosphere(16),
        "spheroid 1 : 1 : 1.6, 2,562": shapes.ellipsoid(16),
        "spheroid 1 : 1 : 0.5, 2,562": shapes.ellipsoid(16, (1, 1, 0.5)),
        "vase, 2,513": shapes.vase(),
    }.items():
        value = asymmetry(mesh)
        print(f"{name}: {value:.2e}, × F² = {value * mesh.topology.n_faces**2:.0f}")


def table_row(name: str, clean: TriangleMesh, sigma: float, count: int = 1, **options: object) -> None:
    noisy = shapes.add_normal_noise(clean, sigma, seed=0)
    start = time.perf_counter()
    done = jaxkvf.symmetrize(noisy, count, **options)  # pyright: ignore[reportArgumentType]
    seconds = time.perf_counter() - start
    account = symmetry_report(noisy, done)
    before, after = (account.dimensionless_before[:count].sum(), account.dimensionless_after[:count].sum())
    low, high = account.smallest_angles
    print(
        f"| {name} | {sigma:.0%} | {before:.2e} | {after:.2e} | {before / after:.1e} | {asymmetry(clean, count):.1e} "
        f"| {account.rms_displacement:.4f} | {low:.1f}° → {high:.1f}° | {account.flipped_faces} "
        f"| {account.steps} | {seconds:.1f} | {OUTCOMES[done.result][:30] or 'successful'} |",
        end="",
    )
    if name == "spheroid":
        distances = [distance_to_revolution(m) / mean_edge(clean) for m in (noisy, done.mesh)]
        print(
            f" RMS distance to the spheroid (best rigid fit) {distances[0]:.4f} → {distances[1]:.4f}",
            end="",
        )
    print(flush=True)


def distance_to_revolution(mesh: TriangleMesh) -> float:
    """RMS distance to the spheroid 1 : 1 : 1.6, where the noise-free mesh has its vertices, after the best rigid motion."""
    x = np.array(mesh.vertices)

    def distances(motion: np.ndarray) -> np.ndarray:
        moved = Rotation.from_rotvec(motion[:3]).apply(x) + motion[3:]
        r, z = np.hypot(moved[:, 0], moved[:, 1]), moved[:, 2]
        level, slope = r**2 + (z / 1.6) ** 2 - 1, np.hypot(2 * r, 2 * z / 1.6**2)
        return level / slope  # to second order in the distance

    found = scipy.optimize.least_squares(distances, np.zeros(6))
    return float(np.sqrt((found.fun**2).mean()))


HEADER = (
    "| shape | noise | λ·area before | after | ratio | noise-free | moved (RMS, mean edges) "
    "| smallest angle | flipped | steps | seconds | result |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
)


def noise() -> None:
    print(HEADER)
    for sigma in (0.02, 0.05, 0.1, 0.2):
        table_row("spheroid", shapes.ellipsoid(16), sigma)


def several_shapes() -> None:
    print(HEADER)
    table_row("bent tube with boundary", bent_tube(), 0.05)
    table_row("torus", shapes.torus(64, 32), 0.05)
    table_row("vase", shapes.vase(), 0.05)
    table_row("sphere, sum of three", shapes.icosphere(16), 0.05, 3)


def large() -> None:
    """A vase of 10,000 vertices, and a step's cost against that of a cold eigensolve with gradient."""
    mesh = shapes.add_normal_noise(shapes.vase(128), 0.05, seed=0)
    times = []
    start = time.perf_counter()

    def note(step: object) -> None:
        times.append((time.perf_counter() - start, step.steps, step.dimensionless[0]))  # pyright: ignore

    done = jaxkvf.symmetrize(mesh, rtol=1e-4, atol=0.0, callback=note)
    seconds = time.perf_counter() - start
    first, last = done.history[0], done.history[-1]
    print(
        f"{mesh.topology.n_vertices} vertices: λ₀·area {first.dimensionless[0]:.3g} → {last.dimensionless[0]:.3g} "
        f"({last.dimensionless[0] / first.dimensionless[0]:.1e} of its start) in {seconds:.1f} s with compilation, "
        f"{last.steps} steps, {OUTCOMES[done.result] or 'successful'}"
    )
    # Steps after compilation, rejected ones counted with the step that follows.
    settled = times[len(times) // 4 :]
    per_step = (settled[-1][0] - settled[0][0]) / (settled[-1][1] - settled[0][1])

    solver = jaxkvf.multigrid_solver(mesh, rtol=1e-10)
    cold = jax.jit(
        jax.value_and_grad(lambda x: jaxkvf.killing_eigenvalues(mesh.with_vertices(x), 1, solver=solver)[0])
    )
    for name, program in {"cold multigrid": cold, "cold, default solver": default_cold(mesh)}.items():
        jax.block_until_ready(program(mesh.vertices))
        samples = []
        for _ in range(5):
            begin = time.perf_counter()
            jax.block_until_ready(program(mesh.vertices))
            samples.append(time.perf_counter() - begin)
        ratio = per_step / np.median(samples)
        print(
            f"{name} eigensolve + gradient {np.median(samples):.3f} s; a step {per_step:.3f} s: ratio {ratio:.2f}"
        )


def default_cold(mesh: TriangleMesh) -> Callable[[jax.Array], object]:
    return jax.jit(jax.value_and_grad(lambda x: jaxkvf.killing_eigenvalues(mesh.with_vertices(x), 1)[0]))


def drivers() -> None:
    """Others minimise the same sum, written by a user with the public functions."""
    print("| vertices | driver | λ₀·area reached | steps | seconds |\n| --- | --- | --- | --- | --- |")
    for frequency, budget in ((4, 60), (16, 100)):
        mesh = shapes.add_normal_noise(shapes.ellipsoid(frequency), 0.05, seed=0)
        before = asymmetry(mesh)
        print(f"| {mesh.topology.n_vertices} | (start) | {before:.2e} | | |")
        original, terms = Configuration.of(mesh), (PositionFidelity(), ShapeBarrier())
        unit = original.unit

        def loss(displacement: jax.Array, mesh=mesh, original=original, terms=terms, unit=unit) -> jax.Array:
            moved = mesh.with_vertices(mesh.vertices + unit * displacement.reshape(-1, 3))
            surface = Configuration.of(moved)
            area = geometry.surface_area(surface.lengths, mesh.topology)
            lowest = jaxkvf.killing_eigenvalues(moved, 1)[0] * area
            return lowest + sum(term(surface, original) for term in terms)

        def optimistix_path(mesh=mesh, budget=budget) -> tuple[jax.Array, int]:
            done = jaxkvf.symmetrize(mesh, rtol=0.0, atol=0.0, max_steps=budget)
            return (done.mesh.vertices - mesh.vertices) / unit, done.stats["steps"]  # noqa: B023

        zero = jnp.zeros(mesh.vertices.shape)
        paths: dict[str, Callable[[], tuple[jax.Array, int]]] = {
            "jaxkvf.symmetrize (optimistix.LBFGS)": optimistix_path
        }
        paths |= jaxopt_paths(loss, zero, budget)
        value_and_grad, value = jax.jit(jax.value_and_grad(loss)), jax.jit(loss)
        paths["SciPy L-BFGS-B, our gradient"] = lambda f=value_and_grad, b=budget, z=zero: scipy_path(
            lambda x: tuple(np.asarray(part, np.float64) for part in f(jnp.asarray(x))), z, b, jac=True
        )
        if frequency == 4:
            paths["SciPy L-BFGS-B, finite differences"] = lambda f=value, z=zero: scipy_path(
                lambda x: float(f(jnp.asarray(x))), z, 40, jac=None
            )
        for name, path in paths.items():
            start = time.perf_counter()
            displacement, steps = path()
            seconds = time.perf_counter() - start
            reached = asymmetry(mesh.with_vertices(mesh.vertices + unit * displacement.reshape(-1, 3)))
            print(
                f"| {mesh.topology.n_vertices} | {name} | {reached:.2e} | {steps} | {seconds:.1f} |",
                flush=True,
            )


def scipy_path(function: Callable, zero: jax.Array, budget: int, jac: bool | None) -> tuple[jax.Array, int]:
    per_gradient = 1 if jac else zero.size + 1
    found = scipy.optimize.minimize(
        function,
        np.zeros(zero.size),
        jac=jac,
        method="L-BFGS-B",
        options={"maxfun": budget * per_gradient, "maxiter": budget, "maxcor": 20, "ftol": 0, "gtol": 1e-9},
    )
    return jnp.asarray(found.x), found.nfev


def jaxopt_paths(loss: Callable, zero: jax.Array, budget: int) -> dict[str, Callable]:
    try:
        import jaxopt  # noqa: PLC0415
    except ImportError:
        print("(jaxopt is not installed)")
        return {}
    count = [0]

    def lbfgs() -> tuple[jax.Array, int]:
        count[0] = 0
        value_and_grad = jax.jit(jax.value_and_grad(loss))

        def counted(x: jax.Array) -> tuple[jax.Array, jax.Array]:
            count[0] += 1
            return value_and_grad(x)

        solver = jaxopt.LBFGS(
            counted, value_and_grad=True, maxiter=budget, history_size=20, tol=1e-9, jit=False
        )
        return solver.run(zero).params, count[0]

    def scipy_minimize() -> tuple[jax.Array, int]:
        solver = jaxopt.ScipyMinimize(
            fun=loss, method="L-BFGS-B", maxiter=budget, tol=1e-12, options={"maxfun": budget, "maxcor": 20}
        )
        found = solver.run(zero)
        return found.params, int(found.state.num_fun_eval)

    return {"jaxopt.LBFGS": lbfgs, "jaxopt.ScipyMinimize": scipy_minimize}


def main() -> None:
    parts = {"floors": floors, "noise": noise, "shapes": several_shapes, "large": large, "drivers": drivers}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=parts)
    parts[parser.parse_args().part]()


if __name__ == "__main__":
    main()
