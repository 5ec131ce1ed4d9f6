"""Decorations that a discrete group of the flow maps to themselves: §4 of the paper."""

from ._decorations import bump as bump
from ._decorations import emboss as emboss
from ._decorations import heights as heights
from ._decorations import paint as paint
from ._decorations import stripes as stripes
from ._files import read_image as read_image
from ._files import save_colored as save_colored
from ._files import save_textured as save_textured
from ._files import texture as texture
from ._files import texture_coordinates as texture_coordinates
from ._pattern import Pattern as Pattern
from ._pattern import fastest_vertex as fastest_vertex
from ._pattern import pattern as pattern
