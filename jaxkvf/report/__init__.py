"""One self-contained HTML page about the symmetry of a mesh.

Needs `pip install "jaxkvf[report]"`; importing it does not.
"""

from ._axis import symmetry_axis as symmetry_axis
from ._contents import Contents as Contents
from ._contents import FlowLines as FlowLines
from ._contents import contents as contents
from ._write import write_report as write_report
