"""Mesh files: OBJ, PLY, OFF and STL, read exactly as they stand."""

from ._attributes import NO_ATTRIBUTES as NO_ATTRIBUTES
from ._attributes import Attributes as Attributes
from ._files import read_mesh as read_mesh
from ._files import read_raw as read_raw
from ._files import write_mesh as write_mesh
