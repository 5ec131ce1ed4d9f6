class MeshError(ValueError):
    """The input is not an oriented manifold triangle mesh with positive areas; the message names what and where."""
