"""From edge lengths to areas, angles and curvatures; tangent frames and transport."""

from ._ambient import embed as embed
from ._ambient import face_frames as face_frames
from ._ambient import face_normals as face_normals
from ._ambient import project as project
from ._ambient import vertex_frames as vertex_frames
from ._ambient import vertex_normals as vertex_normals
from ._duals import angle_defects as angle_defects
from ._duals import barycentric_vertex_areas as barycentric_vertex_areas
from ._duals import circumcentric_vertex_areas as circumcentric_vertex_areas
from ._duals import cone_angles as cone_angles
from ._duals import cotan_weights as cotan_weights
from ._duals import edge_areas as edge_areas
from ._duals import geodesic_curvatures as geodesic_curvatures
from ._metric import corner_angles as corner_angles
from ._metric import corner_cotangents as corner_cotangents
from ._metric import edge_lengths as edge_lengths
from ._metric import face_areas as face_areas
from ._metric import mean_edge_length as mean_edge_length
from ._metric import surface_area as surface_area
from ._tangent import edge_angles as edge_angles
from ._tangent import edge_directions as edge_directions
from ._tangent import rotations as rotations
from ._tangent import spoke_angles as spoke_angles
from ._tangent import transport as transport
from ._tangent import transport_angles as transport_angles
from ._tangent import unit_vectors as unit_vectors
