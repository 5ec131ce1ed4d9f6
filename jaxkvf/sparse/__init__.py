"""Sparse operators: written once as a formula, used as products in JAX and as SciPy matrices. Knows nothing of meshes.

For a discretization of your own: `RowSparseOperator`, `SymmetricBlockOperator` on a `Graph`, and what lineax makes of them;
`declare_leaf`, `assembled` and `matmat` for new kinds; `to_scipy` for their matrices. For a solver or preconditioner:
`block_product`, diagonals, the norm, arithmetic with blocks, and patterns with their layouts.
"""

from ._block_product import BlockProduct as BlockProduct
from ._block_product import block_product as block_product
from ._blocks import apply_blocks as apply_blocks
from ._blocks import gathered as gathered
from ._blocks import gathered_or_zero as gathered_or_zero
from ._blocks import inverse_factors as inverse_factors
from ._blocks import times as times
from ._diagonal import cheap_diagonal as cheap_diagonal
from ._diagonal import known_diagonal_blocks as known_diagonal_blocks
from ._graph import Graph as Graph
from ._matrix_product import ProductLayout as ProductLayout
from ._norm import spectral_norm as spectral_norm
from ._operators import RowSparseOperator as RowSparseOperator
from ._operators import SymmetricBlockOperator as SymmetricBlockOperator
from ._operators import TransposedRowSparseOperator as TransposedRowSparseOperator
from ._operators import assembled as assembled
from ._operators import declare_leaf as declare_leaf
from ._operators import matmat as matmat
from ._rows import RowLayout as RowLayout
from ._rows import RowProduct as RowProduct
from ._sparsity import Sparsity as Sparsity
from ._to_scipy import to_scipy as to_scipy
