"""Meshes to draw, and what is in a picture."""

import numpy as np
from scipy.spatial import ConvexHull

from jaxkvf import TriangleMesh


def arrays(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


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


def read(path):
    from matplotlib.image import imread  # noqa: PLC0415  only where pictures are made

    return imread(path)[:, :, :3].astype(np.float64)


def drawn(picture):
    """Where the picture is not background."""
    return picture.min(axis=2) < 0.99


def gray(colors):
    return np.ptp(colors, axis=-1) < 0.05
