"""From nearly symmetric to exactly symmetric, by moving vertices."""

from ._objective import AbstractTerm as AbstractTerm
from ._objective import PositionFidelity as PositionFidelity
from ._objective import ShapeBarrier as ShapeBarrier
from ._symmetrize import OUTCOMES as OUTCOMES
from ._symmetrize import Step as Step
from ._symmetrize import Symmetrization as Symmetrization
from ._symmetrize import symmetrize as symmetrize
