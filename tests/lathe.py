"""Parts as a lathe makes them: a profile turned about z in a few sides, as coarse and as uneven as CAD leaves them."""

from itertools import pairwise

import numpy as np

from jaxkvf import TriangleMesh


def turned(profile, sides):
    """The mesh of a profile of (radius, height), from bottom to top; radius 0 is one vertex, the centre of a fan."""
    rings, vertices, faces = [], [], []
    angle = 2 * np.pi * np.arange(sides) / sides
    for radius, height in profile:
        count = 1 if radius == 0 else sides
        rings.append(np.resize(len(vertices) + np.arange(count), sides))
        place = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(sides, height)], axis=1)
        vertices.extend(place[:count])
    for low, high in pairwise(rings):
        corners = np.stack([low, np.roll(low, -1), np.roll(high, -1), high], axis=1)
        for triangle in (corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]):
            faces.extend(t for t in triangle if len(set(t)) == 3)
    return TriangleMesh.from_arrays(np.array(vertices, float), np.array(faces))


def random_part(seed):
    """A part of 12 to 100 sides with steps, slivers and fans for caps, and its radii from ring to ring."""
    rng = np.random.default_rng(seed)
    heights = np.cumsum(rng.choice([0.0, 0.01, 0.3, 2.0, 8.0], rng.integers(2, 9)))
    radii = rng.uniform(0.3, 3.0, len(heights))
    profile = list(zip(radii, heights, strict=True))
    profile = [
        p
        for i, p in enumerate(profile)
        if i == 0 or abs(p[0] - profile[i - 1][0]) > 0.05 or p[1] > profile[i - 1][1]
    ]
    bottom, top = rng.random(2) < 0.6
    if bottom:
        profile.insert(0, (0.0, profile[0][1]))
    if top:
        profile.append((0.0, profile[-1][1]))
    return turned(profile, int(rng.integers(12, 101)))


def with_specks(mesh, seed, count=2):
    """The mesh and a few closed specks beside it, from 1/100 to 1/10,000 of its size."""
    rng = np.random.default_rng(seed)
    x, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    size = np.ptp(x, axis=0).max()
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for _ in range(count):
        speck = size * (10.0 ** rng.uniform(-4, -2) * corners + rng.uniform(2, 3, 3))
        x, faces = np.vstack([x, speck]), np.vstack([faces, sides + len(x)])
    return TriangleMesh.from_arrays(x, faces)
