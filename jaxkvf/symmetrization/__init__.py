"""From nearly symmetric to exactly symmetric, by moving vertices."""

from ._configuration import Configuration as Configuration
from ._outcome import OUTCOMES as OUTCOMES
from ._outcome import Symmetrization as Symmetrization
from ._report import SymmetryReport as SymmetryReport
from ._report import symmetry_report as symmetry_report
from ._state import State as State
from ._state import Step as Step
from ._symmetrize import symmetrize as symmetrize
from ._targets import AbstractTarget as AbstractTarget
from ._targets import ChosenField as ChosenField
from ._targets import LowestFields as LowestFields
from ._terms import AbstractTerm as AbstractTerm
from ._terms import LengthFidelity as LengthFidelity
from ._terms import NormalFidelity as NormalFidelity
from ._terms import PositionFidelity as PositionFidelity
from ._terms import ShapeBarrier as ShapeBarrier
from ._terms import VolumeFidelity as VolumeFidelity
from ._unknowns import AbstractUnknowns as AbstractUnknowns
from ._unknowns import Displacements as Displacements
from ._unknowns import EdgeLengths as EdgeLengths
from ._unknowns import Parameters as Parameters
