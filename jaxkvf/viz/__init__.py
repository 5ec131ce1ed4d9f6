"""Pictures of meshes and fields: NumPy arrays in, PNG files out.

`render` draws scenes, off-screen, through polyscope; `plot_…` draws curves through matplotlib; `show` puts either into a
notebook; `to_…` hands a mesh and its fields over to another library.

Needs `pip install "jaxkvf[viz]"` and, on a bare Linux machine, the libraries that `.ci/system-packages`
installs. Importing it needs neither.
"""

from ._adapters import to_pyvista as to_pyvista
from ._adapters import to_trimesh as to_trimesh
from ._camera import X_UP as X_UP
from ._camera import Y_UP as Y_UP
from ._camera import Z_UP as Z_UP
from ._camera import View as View
from ._camera import view_upright as view_upright
from ._colored_mesh import save_colored_mesh as save_colored_mesh
from ._colors import SPEED_MAP as SPEED_MAP
from ._colors import color_map as color_map
from ._render import render as render
from ._scene import CREASE_ANGLE as CREASE_ANGLE
from ._scene import Scene as Scene
from ._scene import Texture as Texture
from ._show import Picture as Picture
from ._show import show as show
from ._spectrum import plot_spectrum as plot_spectrum
from ._sweep import plot_sweep as plot_sweep
