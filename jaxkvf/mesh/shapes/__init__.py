"""Meshes to try things on: spheres, surfaces of revolution, developable surfaces, blobs, noise.

All are made of counter-clockwise triangles seen from outside, deterministic, and without degenerate faces.
"""

from ._blobs import bumpy_sphere as bumpy_sphere
from ._blobs import limbed_blob as limbed_blob
from ._developable import annulus as annulus
from ._developable import cone as cone
from ._developable import cylinder as cylinder
from ._developable import disk as disk
from ._developable import elliptic_cone as elliptic_cone
from ._noise import add_normal_noise as add_normal_noise
from ._revolution import spherical_band as spherical_band
from ._revolution import squashed_cone as squashed_cone
from ._revolution import surface_of_revolution as surface_of_revolution
from ._revolution import torus as torus
from ._revolution import vase as vase
from ._spheres import ellipsoid as ellipsoid
from ._spheres import icosphere as icosphere
from ._spheres import random_sphere as random_sphere
