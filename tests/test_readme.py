"""README as its reader meets it: its Python runs, its commands exist, its picture is there."""

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_python_runs(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.S)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "(4, 1442, 3)" in printed
    assert names["gradient"].shape == (1442, 3)
    before, after = names["fields"].dimensionless[0], names["symmetric"].history[-1].dimensionless[0]
    assert before / after > 1e4  # down to what a symmetric mesh of this size has
    assert (tmp_path / "symmetric.obj").exists()

    (flow,) = re.findall(r"```py\n(.*?)```", README, flags=re.S)
    exec(compile(flow, "README.md", "exec"), names)
    edges = names["mesh"].topology.edges
    before, after = (
        np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
        for x in (names["mesh"].vertices, names["moved"])
    )
    assert np.sqrt(((after / before - 1) ** 2).mean()) < 0.02  # noise keeps it from being an isometry
    moved = np.linalg.norm(names["moved"] - names["mesh"].vertices, axis=1)
    assert 1.0 < moved.mean() < 1.2  # a quarter turn: √2 × π/4, the mean distance from the axis


def test_exactly_two_set_up_commands():
    section = README.split("## Set up")[1].split("\n## ")[0]
    commands = re.findall(r"```sh\n(.*?)```", section, flags=re.S)
    assert len(commands) == 2 and all(len(command.strip().splitlines()) == 1 for command in commands)
    assert "jaxkvf symmetrize" in commands[0] and "pytest" in commands[1]


def test_what_it_points_at_exists():
    targets = re.findall(r"\]\((?!http)([^)#]+)\)", README) + re.findall(
        r"(?:python|bash) ((?:benchmarks|\.ci)/\S+?)[` ]", README
    )
    assert targets
    for target in targets:
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize(
    "name", re.findall(r"`(?:jaxkvf\.)?(TriangleMesh[.\w]*|symmetrize|killing_\w+)", README)
)
def test_names_exist(name):
    import jaxkvf  # noqa: PLC0415

    thing = jaxkvf
    for part in name.split("."):
        thing = getattr(thing, part)
