"""The symmetry of pieces of a surface: of geodesic balls around each place, and of parts it can be cut into."""

from ._local_symmetry import LocalSymmetry as LocalSymmetry
from ._local_symmetry import local_symmetry as local_symmetry
from ._symmetric_parts import SymmetricParts as SymmetricParts
from ._symmetric_parts import symmetric_parts as symmetric_parts
