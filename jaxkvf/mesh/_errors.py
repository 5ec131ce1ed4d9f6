from ..memory import shortage


class MeshError(ValueError):
    """The input is not an oriented manifold triangle mesh with positive areas; the message names what and where."""


class MeshTooLargeError(MeshError, MemoryError):
    """A mesh, or a file of one, that memory will not hold; the message gives the estimate. Raised before any work."""


def check_fits(needed: int, purpose: str) -> None:
    """Refuses what takes more bytes than there are.

    Raises:
        MeshTooLargeError: the message says how much it would take, and how much there is.
    """
    message = shortage(needed, purpose)
    if message is not None:
        raise MeshTooLargeError(message)
