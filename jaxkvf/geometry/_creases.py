"""Creases: edges across which a surface turns by so much that it should not look smooth."""

import numpy as np
from jaxtyping import Bool, Float, Int, Integer
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def split_at_creases(
    vertices: Float[np.ndarray, "V 3"], faces: Integer[np.ndarray, "F 3"], degrees: float
) -> tuple[Int[np.ndarray, "F 3"], Int[np.ndarray, " W"]]:
    """The faces with a copy of each vertex for each smooth part of the surface around it. On the host.

    Normals averaged at the vertices of the result are those of its smooth parts. Where a crease ends within a smooth part,
    its last vertex stays one. Edges of more than two faces, and of two that are not oriented alike, are creases.

    Args:
        vertices: positions, any unit.
        faces: vertex indices, counter-clockwise.
        degrees: faces whose normals make a larger angle meet in a crease.

    Returns:
        the faces in their order, and which vertex each of the new vertices is a copy of: the first V of them are the given.
    """
    corner_vertices = faces.ravel().astype(np.int64)
    labels = connected_components(_joined_corners(vertices, faces, degrees), directed=False)[1]
    _, first, part = np.unique(labels, return_index=True, return_inverse=True)
    owners = corner_vertices[first]
    original = np.zeros(len(owners), bool)
    original[np.unique(owners, return_index=True)[1]] = True
    numbers = np.where(original, owners, len(vertices) - 1 + np.cumsum(~original))
    return numbers[part].reshape(-1, 3), np.concatenate([np.arange(len(vertices)), owners[~original]])


def _joined_corners(
    vertices: Float[np.ndarray, "V 3"], faces: Integer[np.ndarray, "F 3"], degrees: float
) -> coo_array:
    """The graph of the faces' corners that are the same corner of a smooth part."""
    tails = np.arange(faces.size)
    heads = tails - tails % 3 + (tails + 1) % 3
    ends = np.sort(faces.ravel()[np.stack([tails, heads])], axis=0)
    order = np.lexsort(ends)
    same = (ends[:, order[1:]] == ends[:, order[:-1]]).all(axis=0)
    of_three = np.concatenate([[False], same[1:] & same[:-1], [False]])
    pairs = same & ~of_three[1:] & ~of_three[:-1]
    here, there = order[:-1][pairs], order[1:][pairs]
    opposite = faces.ravel()[here] == faces.ravel()[heads[there]]
    smooth = opposite & _turns_little(vertices, faces, here // 3, there // 3, degrees)
    here, there = here[smooth], there[smooth]
    rows, columns = np.concatenate([here, heads[here]]), np.concatenate([heads[there], there])
    return coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(faces.size, faces.size))


def _turns_little(
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    here: Int[np.ndarray, " n"],
    there: Int[np.ndarray, " n"],
    degrees: float,
) -> Bool[np.ndarray, " n"]:
    """Whether the angle between two faces' normals is at most so large; a face without area turns nowhere."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    norms = np.linalg.norm(normals, axis=1)
    cosines = (normals[here] * normals[there]).sum(axis=1)
    return cosines >= np.cos(np.radians(degrees)) * norms[here] * norms[there]
