"""The Killing operator: two discretizations of ∫‖KU‖², one interface."""

from ._dec import Dec as Dec
from ._discretization import AbstractDiscretization as AbstractDiscretization
from ._energy import discretization_named as discretization_named
from ._energy import killing_energy as killing_energy
from ._energy import killing_energy_density as killing_energy_density
from ._hierarchy import vector_hierarchy as vector_hierarchy
from ._on_delaunay import OnIntrinsicDelaunay as OnIntrinsicDelaunay
from ._pieces import Pieces as Pieces
from ._regge import Regge as Regge
from ._regge import thin_faces as thin_faces
from ._regge import vector_mass as vector_mass
