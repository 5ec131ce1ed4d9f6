"""Good meshes broken in known ways, and how to follow the advice of `check` to the letter."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from jaxkvf import MeshReport, Repair, check, repair

Arrays = tuple[np.ndarray, np.ndarray]


def last_digits(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    """Every face has vertices of its own, each off by at most one unit of float32's last digit."""
    x = v[f.ravel()].astype(np.float32)
    turn = rng.integers(-1, 2, x.shape)
    x = np.where(turn == 0, x, np.nextafter(x, np.where(turn > 0, np.inf, -np.inf).astype(np.float32)))
    return x.astype(np.float64), np.arange(f.size).reshape(-1, 3)


def half_sewn(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    """As STL files are: equal corners are one vertex, the others are off in the last digit."""
    x, _ = last_digits(v, f, rng)
    x = np.where(rng.random((len(x), 1)) < 0.6, v[f.ravel()].astype(np.float32), x)
    places, which = np.unique(x, axis=0, return_inverse=True)
    return places, which.reshape(-1, 3)


def doubled(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    again = f[rng.choice(len(f), rng.integers(1, len(f)), replace=False)]
    return v, np.concatenate([f, again[:, ::-1] if rng.random() < 0.5 else np.roll(again, 1, axis=1)])


def flat_chains(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    """Vertices on some sides, seen from one face only; flat faces close the gaps."""
    points, faces = v.tolist(), f.tolist()
    for i in rng.choice(len(f), max(1, len(f) // 9), replace=False):
        a, b, c = faces[i]
        n = int(rng.integers(1, 4))
        on_side = list(range(len(points), len(points) + n))
        points += [(v[a] + (v[b] - v[a]) * 2.0**-k).tolist() for k in range(n, 0, -1)]
        chain = [a, *on_side, b]
        faces[i] = [a, on_side[0], c]
        faces += [[p, q, c] for p, q in pairwise(chain[1:])]
        faces += [[a, q, p] for p, q in pairwise(chain[1:])]
    return np.array(points), np.array(faces)


def sides_without_length(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    """Some inner edges opened into two flat faces around a copy of one end."""
    points, faces = v.tolist(), f.copy()
    for a in rng.choice(len(v), max(1, len(v) // 15), replace=False):
        around = np.flatnonzero((faces == a).any(axis=1))
        after = {int(np.roll(faces[t], -int(np.argmax(faces[t] == a)))[1]): t for t in around}
        start = next(iter(after))
        first = after[start]
        middle = int(np.roll(faces[first], -int(np.argmax(faces[first] == a)))[2])
        if middle not in after:
            continue
        second = after[middle]
        end = int(np.roll(faces[second], -int(np.argmax(faces[second] == a)))[2])
        copy = len(points)
        points.append(points[a])
        for t in (first, second):
            faces[t] = np.where(faces[t] == a, copy, faces[t])
        faces = np.concatenate([faces, [[a, start, copy], [copy, end, a]]])
    return np.array(points), faces


def turned(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    f = f.copy()
    some = rng.choice(len(f), len(f) // 3, replace=False)
    f[some] = f[some, ::-1]
    return v, f


def with_specks(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    n = int(rng.integers(1, 9))
    size = np.ptp(v, axis=0).max()
    specks = v.max(axis=0) + size * (1 + rng.random((n, 1, 3)) + 1e-3 * rng.random((n, 3, 3)))
    return np.concatenate([v, specks.reshape(-1, 3)]), np.concatenate(
        [f, len(v) + np.arange(3 * n).reshape(-1, 3)]
    )


def left_over(v: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> Arrays:
    """Vertices of no face, faces of no vertex, faces with a repeated corner."""
    v = np.concatenate([v, [[np.nan, 0, 0], [1, 2, 3]]])
    a, b = rng.choice(len(f), 2)
    return v, np.concatenate([f, [[f[a, 0], f[a, 0], f[b, 1]], [0, 1, len(v) + 7]]])


BREAKS: dict[str, Callable[[np.ndarray, np.ndarray, np.random.Generator], Arrays]] = {
    make.__name__: make
    for make in (
        turned,
        with_specks,
        flat_chains,
        sides_without_length,
        doubled,
        last_digits,
        half_sewn,
        left_over,
    )
}


def follow(mesh: Arrays, *, remarks: bool = False, at_once: bool = False) -> tuple[Repair, MeshReport]:
    """Repairs by the steps that `check` names, first findings first or all at once, until it names none."""
    done = repair(mesh)
    for _ in range(12):
        report = check((done.vertices, done.faces))
        findings = report.errors or (report.remarks if remarks else ())
        steps = [finding.steps for finding in findings if finding.steps]
        if not steps:
            return done, report
        chosen = {name: value for step in reversed(steps) for name, value in step.items()}
        done = repair((done.vertices, done.faces), **(chosen if at_once else steps[0]))
    raise AssertionError(f"no end to the advice: {report}")
