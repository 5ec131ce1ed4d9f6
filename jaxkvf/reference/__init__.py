"""Analytic and one-dimensional spectra of the Killing energy, to validate against (NumPy and SciPy only)."""

from ._revolution import RevolutionModes as RevolutionModes
from ._revolution import surface_of_revolution_modes as surface_of_revolution_modes
from ._revolution import surface_of_revolution_spectrum as surface_of_revolution_spectrum
from ._sphere import sphere_spectrum as sphere_spectrum
