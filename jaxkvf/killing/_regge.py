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
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, DTypeLike, Float

from ..eigen import GeneralizedEigenproblem
from ..geometry import edge_directions, face_areas, rotations_between, triangle_areas
from ..mesh import Topology
from ..sparse import Graph, SymmetricBlockOperator, assembled, declare_leaf, matmat, to_scipy
from ._discretization import AbstractDiscretization


class Regge(AbstractDiscretization):
    """Tangent vectors at vertices, two unknowns each: positive semi-definite, λ₀ of fourth order, any boundary."""

    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        # Directions are computed once: what is computed twice is differentiated twice.
        directions = edge_directions(lengths, topology)
        return GeneralizedEigenproblem(
            _killing_operator(lengths, directions, topology),
            _mass(mass_areas(lengths[topology.face_edges]), directions, topology),
        )

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
        operator = _killing_operator(lengths, edge_directions(lengths, topology), topology)
        return operator.energies(coefficients[:, None])[0]


def _killing_operator(
    lengths: Float[Array, " E"], directions: Float[Array, "E 2 2"], topology: Topology
) -> "KillingOperator":
    signs = jnp.asarray([-1.0, 1.0], lengths.dtype)[None, :, None]
    return KillingOperator(signs * directions, strain_factors(lengths[topology.face_edges]), topology)


def strain_factors(sides: Float[Array, "F 3"]) -> Float[Array, "F 3 3"]:
    """√area (KU_xx, √2 KU_xy, KU_yy) of each face as a function of the rates ℓ̇ of its sides, x along the longest.

    With the longest side a for unit, and the other two, b after it and c before it, meeting at height t over the fraction
    u of it, h = 2ℓℓ̇ gives KU_xx = 2ℓ̇_a, KU_xy = (cℓ̇_c − bℓ̇_b − (2u − 1)ℓ̇_a)/t and
    KU_yy = 2(c(1 − u)ℓ̇_c + buℓ̇_b − u(1 − u)ℓ̇_a)/t². Dimensionless.

    The last sum is of order t, so the energy of the last two strains grows as 1/t. Where t is below `least_thickness`, 1/t
    is replaced by what it is for a mollified t, so that rounding leaves small eigenvalues their digits; and where an angle
    is that small, as those of a flat obtuse face, the last strain fades, whose direction rounding does not know. Fields
    that stretch no edge still cost nothing, and other faces stay as they are. (Mollified lengths would bend the surface.)

    Reference: N. Sharp, K. Crane, A Laplacian for Nonmanifold Triangle Meshes (2020), §4.5: intrinsic mollification.
    """
    longest = jnp.argmax(sides, axis=1)
    a, b, c = (jnp.take_along_axis(sides, ((longest + i) % 3)[:, None], axis=1)[:, 0] for i in range(3))
    t = 2 * triangle_areas(a, b, c) / (a * a)
    b, c = b / a, c / a
    u = 0.5 * (1 + (c - b) * (c + b))
    zero, root = jnp.zeros_like(t), jnp.sqrt(_mollified(t))
    sine = t / jnp.where(b < c, b, c)  # of the angle at which the shorter side meets the longest
    fade = (sine / _mollified(sine)) ** 2
    along, shear, across = jnp.sqrt(2 * t), 1 / root, 2**0.5 * fade / (root * t)
    rows = (
        (along, zero, zero),
        (-(2 * u - 1) * shear, -b * shear, c * shear),
        (-u * (1 - u) * across, u * b * across, (1 - u) * c * across),
    )
    from_longest = jnp.stack([jnp.stack(row, axis=1) for row in rows], axis=1)
    place = (jnp.arange(3, dtype=longest.dtype)[None] - longest[:, None]) % 3
    return jnp.take_along_axis(from_longest, place[:, None, :], axis=2)


def corner_strains(
    factors: Float[Array, "F 3 3"], starts: Float[Array, "F 3 2"], ends: Float[Array, "F 3 2"]
) -> Float[Array, "F 3 3 2"]:
    """Strains of each face by the vector at each of its corners, from the rates of sides by those where they start and end.

    Cancellation among the sides of a thin face happens here, before anything is squared.
    """
    corners = []
    for c in range(3):  # the start of side c and the end of side c − 1
        start = factors[:, :, c, None] * starts[:, None, c]
        corners.append(start + factors[:, :, c - 1, None] * ends[:, None, c - 1])
    return jnp.stack(corners, axis=2)


def least_thickness(dtype: DTypeLike) -> float:
    """Height over longest side below which a face is mollified: ε^⅓, 6e-6 in float64 and 0.005 in float32. Dimensionless.

    Stiffness and inverse mass that grow as 1 / thickness then leave the small eigenvalues ε^⅓ of their typical size.
    """
    return float(np.finfo(dtype).eps) ** (1 / 3)


def thin_faces(lengths: Float[Array, " E"], topology: Topology) -> Bool[Array, " F"]:
    """Which faces `regge` mollifies: so thin that their strain would be lost in rounding (height below ε^⅓ of the side)."""
    return _thicknesses(lengths[topology.face_edges]) < least_thickness(lengths.dtype)


def _thicknesses(sides: Float[Array, "F 3"]) -> Float[Array, " F"]:
    """Height over the longest side, relative to it. Dimensionless."""
    return 2 * triangle_areas(*sides.T) / sides.max(axis=1) ** 2


def _mollified(thickness: Float[Array, " F"]) -> Float[Array, " F"]:
    """Lifted smoothly to at least half of `least_thickness`; the same from there on."""
    least = least_thickness(thickness.dtype)
    return jnp.where(thickness < least, (thickness * thickness + least * least) / (2 * least), thickness)


def energy_density(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, " F"]:
    """‖KU‖² in each face, pointwise. Unit: (vector / length)²."""
    operator = _killing_operator(lengths, edge_directions(lengths, topology), topology)
    return (operator.root(vectors.reshape(-1, 1)) ** 2).sum(axis=(1, 2)) / face_areas(lengths, topology)


class KillingOperator(lx.AbstractLinearOperator):
    """A with xᵀAx = Σ_f |strain of f|², kept in its factors: x → rates of the edges → strains of the faces and back.

    The factors are what derivatives flow through, at a quarter of the cost of going through the assembled matrix, and
    they give the small energies of nearly symmetric fields without cancellation.
    """

    rate_coefficients: Float[Array, "E 2 2"]
    """∂ℓ̇_e/∂U at tail and head of each edge: ∓ its unit tangent there."""
    strain_factors: Float[Array, "F 3 3"]
    """Strains of each face, × √area, in an orthonormal frame, by the rates ℓ̇ of its sides."""
    topology: Topology

    def mv(self, vector: Float[Array, " n"]) -> Float[Array, " n"]:
        return matmat(self, vector[:, None])[:, 0]

    def energies(self, block: Float[Array, "n k"]) -> Float[Array, " k"]:
        """xᵀAx of each column, without the product: derivatives cost half."""
        return (self.root(block) ** 2).sum(axis=(0, 1))

    def root(self, block: Float[Array, "n k"]) -> Float[Array, "F 3 k"]:
        """R x with A = RᵀR: the strains of each face."""
        return jnp.einsum("fts,fsk->ftk", self.strain_factors, self._side_rates(block))

    def corner_strains(self) -> Float[Array, "F 3 3 2"]:
        """Strains of each face by the vector at each of its corners: rows of R."""
        rates = self.rate_coefficients[self.topology.face_edges]
        along = (self.topology.face_edge_signs > 0)[..., None]
        starts = jnp.where(along, rates[:, :, 0], rates[:, :, 1])
        ends = jnp.where(along, rates[:, :, 1], rates[:, :, 0])
        return corner_strains(self.strain_factors, starts, ends)

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
    sides = jnp.einsum("fts,ftk->fsk", operator.strain_factors, operator.root(block))
    at_edges = _sum_over(topology.face_edges, sides, topology.n_edges)
    at_ends = operator.rate_coefficients[..., None] * at_edges[:, None, None, :]
    return _sum_over(topology.edges, at_ends, topology.n_vertices).reshape(block.shape)


@to_scipy.register
def _(operator: KillingOperator) -> sp.csr_array:
    return to_scipy(assembled(operator))


@assembled.register
@jax.jit
def _(operator: KillingOperator) -> SymmetricBlockOperator:
    topology, strains = operator.topology, operator.corner_strains()

    def block(a: int, b: int) -> Float[Array, "F 2 2"]:
        """Rows of corner a, columns of corner b."""
        return (strains[:, :, a, :, None] * strains[:, :, b, None, :]).sum(axis=1)

    # One corner and one side at a time: all at once take three times the memory.
    dtype = strains.dtype
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
    return _mass(mass_areas(lengths[topology.face_edges]), edge_directions(lengths, topology), topology)


def mass_areas(sides: Float[Array, "F 3"]) -> Float[Array, " F"]:
    """Areas of faces with these sides, mollified: what they weigh. Unit: length²."""
    return 0.5 * sides.max(axis=1) ** 2 * _mollified(_thicknesses(sides))


CORNER_SHARE, SIDE_SHARE = 1 / 4, 1 / 24
"""Of a face's area in the mass: at each corner, and between the ends of each side."""


def _mass(
    areas: Float[Array, " F"], directions: Float[Array, "E 2 2"], topology: Topology
) -> SymmetricBlockOperator:
    around = jnp.broadcast_to(areas[:, None], (topology.n_faces, 3))
    vertex = CORNER_SHARE * _sum_over(topology.faces, around, topology.n_vertices)
    edge = SIDE_SHARE * _sum_over(topology.face_edges, around, topology.n_edges)
    return SymmetricBlockOperator(
        diagonal=vertex[:, None, None] * jnp.eye(2, dtype=areas.dtype)[None],
        upper=edge[:, None, None] * rotations_between(directions[:, 1], directions[:, 0]),
        graph=_graph(topology),
    )


def _graph(topology: Topology) -> Graph:
    """Of the edges; those that meet at a vertex are its spokes."""
    from_head = jnp.where(topology.is_tail_spoke, 0, topology.n_edges).astype(topology.spoke_edges.dtype)
    return Graph(topology.edges, topology.spoke_starts, topology.spoke_edges + from_head)


def _sum_over(indices: Array, values: Float[Array, "m w *block"], count: int) -> Float[Array, "count *block"]:
    return jax.ops.segment_sum(values.reshape(-1, *values.shape[2:]), indices.ravel(), num_segments=count)
