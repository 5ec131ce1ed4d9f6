"""Mesh files: OBJ, PLY, OFF and STL, read exactly as they stand."""

from ._files import read_attributes as read_attributes
from ._files import read_mesh as read_mesh
from ._files import read_raw as read_raw
from ._files import write_mesh as write_mesh
