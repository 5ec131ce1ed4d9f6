"""The Killing operator as the rate of change of edge lengths: vertex vectors in, a Regge metric tensor out.

Moving the vertices along a field U changes the length of edge ij at the rate ℓ̇ = ⟨U_j, e⟩ − ⟨U_i, e⟩ (first variation of arc
length), each inner product taken in the vertex's own intrinsic frame. The rates h = 2ℓℓ̇ of a face's three sides are the edge
values of the symmetric tensor KU = L_U g in the lowest-order Regge element, constant in the face:

    KU = Σ_e h_e S_e,   S_e = −sym(∇λ_i ⊗ ∇λ_j),   e = ij.

Positive semi-definite by construction, with natural boundary conditions.

References: T. Regge, General relativity without coordinates (1961); S. Christiansen, On the linearization of Regge calculus
(2011) for the element.
"""

import jax
import jax.numpy as jnp
import lineax as lx
import scipy.sparse as sp
from jaxtyping import Array, Float

from ..eigen import GeneralizedEigenproblem
from ..geometry import corner_cotangents, edge_directions, face_areas, rotations_between
from ..mesh import Topology
from ..sparse import Graph, SymmetricBlockOperator, assembled, declare_leaf, matmat, to_scipy
from ._discretization import AbstractDiscretization


class Regge(AbstractDiscretization):
    """Tangent vectors at vertices, two unknowns each: positive semi-definite, λ₀ of fourth order, any boundary."""

    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        # Areas and directions are computed once: what is computed twice is differentiated twice.
        areas, directions = face_areas(lengths, topology), edge_directions(lengths, topology)
        A = KillingOperator(
            _rate_coefficients(lengths, directions),
            areas[:, None, None] * _tensor_products(lengths, areas, topology),
            topology,
        )
        return GeneralizedEigenproblem(A, _mass(areas, directions, topology))

    def to_vertex_vectors(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, "V 2"]:
        return coefficients.reshape(-1, 2)

    def from_vertex_vectors(
        self, vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, " n"]:
        return vectors.ravel()

    def energy(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, ""]:
        vectors = coefficients.reshape(-1, 2)
        return (face_areas(lengths, topology) * energy_density(vectors, lengths, topology)).sum()


def squared_length_rates(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, " E"]:
    """h_e = d/dt ℓ² along the flow of a vertex field: 2ℓ (⟨U_head, e⟩ − ⟨U_tail, e⟩). Unit: vector × length."""
    coefficients = _rate_coefficients(lengths, edge_directions(lengths, topology))
    return (vectors[topology.edges] * coefficients).sum(axis=(1, 2))


def _rate_coefficients(
    lengths: Float[Array, " E"], directions: Float[Array, "E 2 2"]
) -> Float[Array, "E 2 2"]:
    """∂h_e/∂U at tail and head of each edge."""
    signs = jnp.asarray([-1.0, 1.0], lengths.dtype)[None, :, None]
    return 2 * lengths[:, None, None] * signs * directions


def _tensor_products(
    lengths: Float[Array, " E"], areas: Float[Array, " F"], topology: Topology
) -> Float[Array, "F 3 3"]:
    """⟨S_e, S_e'⟩ of the sides of each face: ½ (g_ac g_bd + g_ad g_bc), g_ij = ∇λ_i·∇λ_j, from lengths alone."""
    # −g_ij is that of the third corner
    x, y, z = (corner_cotangents(lengths, topology) / (2 * areas[:, None])).T
    # ∇λ_i·(∇λ_i + ∇λ_j + ∇λ_k) = 0
    g = ((y + z, -z, -y), (-z, z + x, -x), (-y, -x, x + y))

    def product(side: int, other: int) -> Float[Array, " F"]:
        (a, b), (c, d) = ((s, (s + 1) % 3) for s in (side, other))  # side s joins corners s and s + 1
        return 0.5 * (g[a][c] * g[b][d] + g[a][d] * g[b][c])

    return jnp.stack([jnp.stack([product(s, t) for t in range(3)], axis=1) for s in range(3)], axis=1)


def energy_density(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, " F"]:
    """‖KU‖² in each face, pointwise. Unit: (vector / length)²."""
    sides = squared_length_rates(vectors, lengths, topology)[topology.face_edges]
    products = _tensor_products(lengths, face_areas(lengths, topology), topology)
    return jnp.einsum("fs,fst,ft->f", sides, products, sides)


class KillingOperator(lx.AbstractLinearOperator):
    """A with xᵀAx = Σ_f area_f hᵀ⟨S, S⟩h, kept in its factors: x → rates of the edges → tensors of the faces and back.

    The factors are what derivatives flow through, at a quarter of the cost of going through the assembled matrix, and
    they give the small energies of nearly symmetric fields without cancellation.
    """

    rate_coefficients: Float[Array, "E 2 2"]
    """∂h_e/∂U at tail and head of each edge."""
    side_products: Float[Array, "F 3 3"]
    """area × ⟨S_e, S_e'⟩ of the sides of each face."""
    topology: Topology

    def mv(self, vector: Float[Array, " n"]) -> Float[Array, " n"]:
        return matmat(self, vector[:, None])[:, 0]

    def energies(self, block: Float[Array, "n k"]) -> Float[Array, " k"]:
        """xᵀAx of each column, without the product: derivatives cost half."""
        rates = self._side_rates(block)
        return jnp.einsum("fsk,fst,ftk->k", rates, self.side_products, rates)

    def root(self, block: Float[Array, "n k"]) -> Float[Array, "F 3 k"]:
        """R x with A = RᵀR: the strains of each face."""
        factor = jnp.linalg.cholesky(self.side_products)
        return jnp.einsum("fst,fsk->ftk", factor, self._side_rates(block))

    def _side_rates(self, block: Float[Array, "n k"]) -> Float[Array, "F 3 k"]:
        vectors = block.reshape(self.topology.n_vertices, 2, -1)
        rates = jnp.einsum("eac,eack->ek", self.rate_coefficients, vectors[self.topology.edges])
        return rates[self.topology.face_edges]

    def as_matrix(self) -> Float[Array, "n n"]:
        return assembled(self).as_matrix()

    def transpose(self) -> "KillingOperator":
        return self

    def in_structure(self) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((2 * self.topology.n_vertices,), self.rate_coefficients.dtype)

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return self.in_structure()


declare_leaf(KillingOperator, positive_semidefinite=True)


@matmat.register
def _(operator: KillingOperator, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
    topology = operator.topology
    sides = jnp.einsum("fst,ftk->fsk", operator.side_products, operator._side_rates(block))
    at_edges = _sum_over(topology.face_edges, sides, topology.n_edges)
    at_ends = operator.rate_coefficients[..., None] * at_edges[:, None, None, :]
    return _sum_over(topology.edges, at_ends, topology.n_vertices).reshape(block.shape)


@to_scipy.register
def _(operator: KillingOperator) -> sp.csr_array:
    return to_scipy(assembled(operator))


@assembled.register
@jax.jit
def _(operator: KillingOperator) -> SymmetricBlockOperator:
    topology, products = operator.topology, operator.side_products
    starts, ends = [], []  # ∂h/∂U of each side of a face, at the corner where it starts and where it ends
    for side in range(3):
        rates = operator.rate_coefficients[topology.face_edges[:, side]]
        along = (topology.face_edge_signs[:, side] > 0)[:, None]
        starts.append(jnp.where(along, rates[:, 0], rates[:, 1]))
        ends.append(jnp.where(along, rates[:, 1], rates[:, 0]))

    def block(a: int, b: int) -> Float[Array, "F 2 2"]:
        """Rows of corner a, columns of corner b: corner c is the start of side c and the end of side c − 1."""

        def row(side: int) -> Float[Array, "F 1 2"]:
            at_b = products[:, side, b, None] * starts[b] + products[:, side, b - 1, None] * ends[b - 1]
            return at_b[:, None, :]

        return starts[a][:, :, None] * row(a) + ends[a - 1][:, :, None] * row(a - 1)

    # One corner and one side at a time: all at once take three times the memory.
    dtype = products.dtype
    diagonal = jnp.zeros((topology.n_vertices, 2, 2), dtype)
    upper = jnp.zeros((topology.n_edges, 2, 2), dtype)
    for c in range(3):
        on_side = block(c, (c + 1) % 3)
        along = (topology.face_edge_signs[:, c] > 0)[:, None, None]
        from_tail = jnp.where(along, on_side, on_side.mT)
        diagonal = diagonal.at[topology.faces[:, c]].add(block(c, c))
        upper = upper.at[topology.face_edges[:, c]].add(from_tail)
    return SymmetricBlockOperator(diagonal, upper, _graph(topology))


def vector_mass(lengths: Float[Array, " E"], topology: Topology) -> SymmetricBlockOperator:
    """B with xᵀBx = ∫|U|²: half lumped, half consistent P1 with transport along the edges.

    The blend cancels the leading dispersion error of either. Diagonally dominant, hence positive definite.
    """
    return _mass(face_areas(lengths, topology), edge_directions(lengths, topology), topology)


def _mass(
    areas: Float[Array, " F"], directions: Float[Array, "E 2 2"], topology: Topology
) -> SymmetricBlockOperator:
    around = jnp.broadcast_to(areas[:, None], (topology.n_faces, 3))
    vertex = _sum_over(topology.faces, around, topology.n_vertices) / 4
    edge = _sum_over(topology.face_edges, around, topology.n_edges) / 24
    head_to_tail = rotations_between(directions[:, 1], directions[:, 0])
    return SymmetricBlockOperator(
        diagonal=vertex[:, None, None] * jnp.eye(2, dtype=areas.dtype)[None],
        upper=edge[:, None, None] * head_to_tail,
        graph=_graph(topology),
    )


def _graph(topology: Topology) -> Graph:
    """Of the edges; those that meet at a vertex are its spokes."""
    from_head = jnp.where(topology.is_tail_spoke, 0, topology.n_edges).astype(topology.spoke_edges.dtype)
    return Graph(topology.edges, topology.spoke_starts, topology.spoke_edges + from_head)


def _sum_over(indices: Array, values: Float[Array, "m w *block"], count: int) -> Float[Array, "count *block"]:
    return jax.ops.segment_sum(values.reshape(-1, *values.shape[2:]), indices.ravel(), num_segments=count)
