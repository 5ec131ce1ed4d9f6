"""Discrete exterior calculus on the edges, vertices and faces of a mesh."""

from ._musical import end_components as end_components
from ._musical import face_side_directions as face_side_directions
from ._musical import flat as flat
from ._musical import flat_faces as flat_faces
from ._musical import flat_operator as flat_operator
from ._musical import sharp as sharp
from ._musical import sharp_faces as sharp_faces
from ._musical import sharp_operator as sharp_operator
from ._operators import codifferential1 as codifferential1
from ._operators import codifferential2 as codifferential2
from ._operators import curl_curl as curl_curl
from ._operators import d0 as d0
from ._operators import d1 as d1
from ._operators import grad_div as grad_div
from ._operators import hodge0 as hodge0
from ._operators import hodge1 as hodge1
from ._operators import hodge2 as hodge2
from ._operators import hodge_laplacian0 as hodge_laplacian0
from ._operators import hodge_laplacian1 as hodge_laplacian1
