import numpy as np


def check_positive(name: str, value: float | int) -> None:
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive, got {value!r}")
