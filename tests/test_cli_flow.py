"""`jaxkvf flow` and `jaxkvf pattern` as their user meets them."""

import json
from pathlib import Path

import numpy as np
import pytest

from jaxkvf import TriangleMesh, cli, shapes


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    shapes.ellipsoid(8).save("spheroid.obj")


@pytest.mark.slow
def test_flow_reports_the_period_and_writes_curves(capsys, offscreen):
    arguments = ["flow", "spheroid.obj", "-o", "flow.npz", "--json", "--picture", "flow.png", "--curves", "5"]
    assert cli.main(arguments) == 0 and Path("flow.png").exists()
    report = json.loads(capsys.readouterr().out)
    assert report["closed_curves"] == 64 and report["relative_rms_edge_error"] < 0.01
    assert report["time"] == report["period"]
    with np.load("flow.npz") as saved:
        assert saved["curves"].shape[0] == 5 and saved["vertices"].shape == (642, 3)
        x, turn = np.asarray(TriangleMesh.load("spheroid.obj").vertices), saved["vectors"]
    speed, radius = np.linalg.norm(turn, axis=1), np.hypot(x[:, 0], x[:, 1])
    assert report["period"] == pytest.approx(2 * np.pi * (radius @ radius) / (speed @ radius), rel=0.01)


@pytest.mark.slow
def test_pattern_writes_textured_and_coloured_meshes(capsys, offscreen):
    for out in ("p.glb", "p.obj", "p.ply"):
        picture = ["--picture", "pattern.png"] if out == "p.glb" else ["--no-picture"]
        assert cli.main(["pattern", "spheroid.obj", "-o", out, "-m", "5", "--json", *picture]) == 0
        assert json.loads(capsys.readouterr().out)["copies"] == 5
    assert (
        cli.main(["pattern", "spheroid.obj", "-o", "s.ply", "-m", "5", "--stripes", "across", "--no-picture"])
        == 0
    )
    assert {"p.glb", "p.obj", "p.mtl", "p.png", "p.ply", "s.ply", "pattern.png"} <= {
        p.name for p in Path().iterdir()
    }
    assert TriangleMesh.load("p.obj").topology.n_vertices > 642  # refined around the disks


def test_what_cannot_be_done_says_why(capsys):
    for arguments, message in (
        (["flow", "nowhere.obj"], "nowhere.obj"),
        (["pattern", "spheroid.obj", "-o", "no/p.glb"], "the folder"),
        (["pattern", "spheroid.obj", "-o", "p.glb", "--stripes", "along"], "write them to a .ply"),
        (["pattern", "spheroid.obj", "-o", "p.glb", "--image", "none.png"], "none.png"),
    ):
        assert cli.main([*arguments, "--no-picture"]) == 1
        error = capsys.readouterr().err
        assert error.startswith("jaxkvf: ") and message in error and "Traceback" not in error
    for arguments in (
        ["flow"],
        ["pattern", "x.obj"],
        ["pattern", "x.obj", "-o", "p.stl"],
        ["flow", "x", "-t", "nan"],
    ):
        with pytest.raises(SystemExit) as stopped:
            cli.main(arguments)
        assert stopped.value.code == 2
