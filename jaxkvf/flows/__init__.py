"""The flow of a tangent field: where it takes points, how nearly it is an isometry, its period and its discrete groups."""

from ._bracket import lie_bracket as lie_bracket
from ._closed import ClosedField as ClosedField
from ._closed import closed_field as closed_field
from ._curves import IntegralCurves as IntegralCurves
from ._curves import integral_curves as integral_curves
from ._flow import Flow as Flow
from ._flow import FlowStatus as FlowStatus
from ._flow import advect_vertices as advect_vertices
from ._flow import flow as flow
from ._isometry import DistanceDistortion as DistanceDistortion
from ._isometry import Isometry as Isometry
from ._isometry import distance_distortion as distance_distortion
from ._isometry import isometry_error as isometry_error
from ._period import NoPeriodError as NoPeriodError
from ._period import Orbit as Orbit
from ._period import Period as Period
from ._period import orbit as orbit
from ._period import period as period
