"""Harmonic fields: the kernel of the Hodge Laplacian, exactly as many as the topology asks for."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.sparse.linalg import splu

from .exterior import d0, d1, sharp
from .geometry import cotan_weights, edge_lengths, embed, vertex_frames
from .killing import vector_mass
from .mesh import Topology, TriangleMesh
from .sparse import SymmetricBlockOperator, to_scipy


class HarmonicFields(eqx.Module):
    """An orthonormal basis of the harmonic fields: without divergence and without curl."""

    vectors: Float[Array, "b V 3"]
    """Tangent vectors at the vertices, of unit norm ∫|U|² = 1 and orthogonal to one another. Unit: length⁻¹."""
    forms: Float[Array, "b E"]
    """The same as 1-forms, integrated along the edges: dω = 0 and d₀ᵀ⋆₁ω = 0. Dimensionless."""


def harmonic_fields(mesh: TriangleMesh, *, boundary: str = "tangential") -> HarmonicFields:
    """The kernel of the Hodge Laplacian on 1-forms: 2·genus fields; 2·genus + loops − 1 a component with boundary.

    On a surface with a Killing field U, ⟨harmonic, U⟩ is constant (Yano; Fig. 12 of the paper). Closed forms that are not
    exact come from a tree of vertices and a tree of faces that share no edge; taking away a gradient (one Poisson solve)
    makes them harmonic. No eigenvalue has to be told from zero, and the discrete forms are in the kernel to rounding.

    Args:
        mesh: the surface.
        boundary: `"tangential"`: the fields run along the boundary (absolute cohomology); `"normal"`: they stand on it
            (cohomology relative to the boundary). Without boundary it makes no difference.

    Returns:
        The fields; of shape `[0, V, 3]` on a sphere or disk.

    Raises:
        ValueError: unknown `boundary`.
    """
    if boundary not in {"tangential", "normal"}:
        raise ValueError(f"boundary must be 'tangential' or 'normal', got {boundary!r}")
    topology = mesh.topology
    lengths = edge_lengths(mesh.vertices, topology)
    relative = boundary == "normal"
    closed = _closed_forms(topology, relative)
    forms = closed - _gradients(closed, topology, lengths, relative)
    vectors, mass = _vertex_fields(jnp.asarray(forms, lengths.dtype), lengths, topology)
    if len(forms):
        flat = np.asarray(vectors).reshape(len(forms), -1)
        orthonormal = np.linalg.inv(np.linalg.cholesky(flat @ (to_scipy(mass) @ flat.T)))
        vectors = jnp.einsum("ij,jvc->ivc", jnp.asarray(orthonormal, lengths.dtype), vectors)
        forms = orthonormal @ forms
    frames = vertex_frames(mesh.vertices, topology)
    return HarmonicFields(embed(vectors, frames), jnp.asarray(forms, lengths.dtype))


@eqx.filter_jit
def _vertex_fields(
    forms: Float[Array, "b E"], lengths: Float[Array, " E"], topology: Topology
) -> tuple[Float[Array, "b V 2"], SymmetricBlockOperator]:
    """The forms as vertex vectors, and the mass that makes ∫⟨U, W⟩ of them."""
    return jax.vmap(lambda form: sharp(form, lengths, topology))(forms), vector_mass(lengths, topology)


def _closed_forms(topology: Topology, relative: bool) -> Float[np.ndarray, "b E"]:
    """1-forms with dω = 0 that span the cohomology, relative to the boundary (zero along it) or not.

    Tree–cotree: each edge that is in neither tree is given the value 1, the others of its kind and the tree of vertices 0;
    the faces then determine the values on the tree of faces. Relative to the boundary, the boundary is one vertex;
    otherwise the outside is one face.

    Reference: J. Erickson, K. Whittlesey, Greedy optimal homotopy and homology generators (2005).
    """
    edges, sides = np.asarray(topology.edges), np.asarray(topology.edge_faces)
    n_vertices, n_faces = topology.n_vertices, topology.n_faces
    inside = np.asarray((sides >= 0).all(axis=1))
    usable = inside if relative else np.ones_like(inside)
    if relative:
        edges = np.where(np.asarray(topology.is_boundary_vertex), n_vertices, np.arange(n_vertices))[edges]
    sides = np.where(sides < 0, n_faces, sides)
    tree = _spanning_forest(edges, usable, n_vertices + 1)
    cotree = _spanning_forest(sides, np.logical_and(usable, ~tree), n_faces + 1)
    generators = np.flatnonzero(usable & ~tree & ~cotree)
    forms = np.zeros((len(generators), topology.n_edges))
    forms[np.arange(len(generators)), generators] = 1.0
    if len(generators):
        curl = sp.csc_array(to_scipy(d1(topology, float)), dtype=np.float64)  # JAX may hold float32 alone
        links = sp.coo_array(
            (np.ones(cotree.sum()), tuple(sides[cotree].T)), shape=(n_faces + 1, n_faces + 1)
        )
        _, part = connected_components(links, directed=False)
        _, roots = np.unique(
            part[::-1], return_index=True
        )  # the outside, where it is part of a tree, or a face
        kept = np.setdiff1d(np.arange(n_faces), n_faces - roots)
        on_cotree = splu(sp.csc_matrix(curl[kept][:, np.flatnonzero(cotree)]))
        forms[:, cotree] = -on_cotree.solve(curl[kept] @ forms.T).T
    return forms


def _spanning_forest(
    ends: Int[np.ndarray, "E 2"], usable: Bool[np.ndarray, " E"], n: int
) -> Bool[np.ndarray, " E"]:
    """Which of the usable edges are in a spanning forest of the graph on n nodes."""
    low, high = ends.min(axis=1).astype(np.int64), ends.max(axis=1)
    candidates = np.flatnonzero(usable & (low < high))
    _, first = np.unique(low[candidates] * n + high[candidates], return_index=True)  # of parallel edges, one
    candidates = candidates[first]
    graph = sp.coo_array((candidates + 1.0, (low[candidates], high[candidates])), shape=(n, n))
    chosen = np.zeros(len(ends), bool)
    chosen[minimum_spanning_tree(graph).data.astype(np.int64) - 1] = True
    return chosen


def _gradients(
    forms: Float[np.ndarray, "b E"], topology: Topology, lengths: Float[Array, " E"], relative: bool
) -> Float[np.ndarray, "b E"]:
    """The exact part of each form: d₀u with d₀ᵀ⋆₁(ω − d₀u) = 0, u = 0 on the boundary if relative to it."""
    gradient = sp.csr_array(to_scipy(d0(topology, float)), dtype=np.float64)
    weighted = gradient.T @ sp.diags_array(np.asarray(cotan_weights(lengths, topology), float))
    fixed = np.array(topology.is_boundary_vertex) if relative else np.zeros(topology.n_vertices, bool)
    _, component = topology.components()
    held = np.unique(component[fixed])
    labels, first = np.unique(component, return_index=True)
    fixed[first[~np.isin(labels, held)]] = True  # where nothing else fixes u, its value at one vertex
    u = np.zeros((topology.n_vertices, len(forms)))
    if len(forms):
        free = np.flatnonzero(~fixed)
        laplacian = sp.csc_matrix((weighted @ gradient)[free][:, free])
        options = {"SymmetricMode": True}
        solve = splu(laplacian, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options=options).solve
        u[free] = solve((weighted @ forms.T)[free])
    return (gradient @ u).T
