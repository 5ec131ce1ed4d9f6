"""The infinitesimal rigid motion that is closest to a field."""

import equinox as eqx
import numpy as np
from jaxtyping import Float


class RigidMotion(eqx.Module):
    """The field x ↦ ω × (x − c) + v."""

    rotation: Float[np.ndarray, "3"]
    """ω. Unit: the field's / length."""
    translation: Float[np.ndarray, "3"]
    """v, the field's mean. Unit: the field's."""
    center: Float[np.ndarray, "3"]
    """c, the mean position."""
    misfit: float
    """√(Σ w |u − fit|² / Σ w |u|²): 0 for a rigid motion, at most 1."""


def closest_rigid_motion(
    vertices: Float[np.ndarray, "V 3"], vectors: Float[np.ndarray, "V 3"], weights: Float[np.ndarray, " V"]
) -> RigidMotion:
    """The rigid motion closest to a field in weighted least squares. On the host.

    About the mean position translation and rotation decouple: v is the mean of u, and ω solves
    inertia · ω = Σ w (x − c) × u.

    Args:
        vertices: positions. Unit: length.
        vectors: a field at them, in space, not 0 everywhere.
        weights: such as the areas around the vertices; at least 0.
    """
    share = (weights / weights.sum())[:, None]
    center, translation = (share * vertices).sum(axis=0), (share * vectors).sum(axis=0)
    arms = vertices - center
    inertia = (share * arms**2).sum() * np.eye(3) - (share * arms).T @ arms
    rotation = np.linalg.pinv(inertia, hermitian=True) @ (share * np.cross(arms, vectors)).sum(axis=0)
    rest = vectors - translation - np.cross(rotation, arms)
    misfit = np.sqrt((share * rest**2).sum() / (share * vectors**2).sum())
    return RigidMotion(rotation, translation, center, float(misfit))
