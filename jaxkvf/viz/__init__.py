"""Pictures of meshes and fields: NumPy arrays in, PNG files out.

`render_…` draws surfaces, off-screen, through polyscope; `plot_…` draws curves through matplotlib; `show` puts either into a
notebook; `to_…` hands a mesh and its fields over to another library.

Needs `pip install "jaxkvf[viz]"` and, on a bare Linux machine, the libraries that `.ci/system-packages`
installs. Importing it needs neither.
"""

from ._adapters import to_pyvista as to_pyvista
from ._adapters import to_trimesh as to_trimesh
from ._before_after import render_before_after as render_before_after
from ._camera import Y_UP as Y_UP
from ._camera import Z_UP as Z_UP
from ._camera import View as View
from ._colored import render_colored as render_colored
from ._colored_mesh import save_colored_mesh as save_colored_mesh
from ._colors import SPEED_MAP as SPEED_MAP
from ._colors import color_map as color_map
from ._field import render_field as render_field
from ._fields import render_fields as render_fields
from ._flow_lines import render_flow_lines as render_flow_lines
from ._mesh import render_mesh as render_mesh
from ._pattern import render_pattern as render_pattern
from ._photo import Texture as Texture
from ._samples import Samples as Samples
from ._samples import spread_evenly as spread_evenly
from ._scene import Scene as Scene
from ._series import render_series as render_series
from ._show import Picture as Picture
from ._show import show as show
from ._spectrum import plot_spectrum as plot_spectrum
from ._sweep import plot_sweep as plot_sweep
