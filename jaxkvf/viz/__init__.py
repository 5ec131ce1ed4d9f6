"""Pictures of meshes and fields, rendered off-screen: NumPy arrays in, PNG files out.

Needs `pip install "jaxkvf[viz]"` and, on a bare Linux machine, the libraries that `.ci/system-packages`
installs. Importing it needs neither.
"""

from ._before_after import render_before_after as render_before_after
from ._camera import Y_UP as Y_UP
from ._camera import Z_UP as Z_UP
from ._camera import View as View
from ._colored import render_colored as render_colored
from ._colored_mesh import save_colored_mesh as save_colored_mesh
from ._field import render_field as render_field
from ._fields import render_fields as render_fields
from ._mesh import render_mesh as render_mesh
