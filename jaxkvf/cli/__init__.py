"""The command line `jaxkvf`."""

from ._main import main as main
