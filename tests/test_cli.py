"""The command line as its user meets it: exit codes, messages, files."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxkvf import TriangleMesh, cli, killing_fields, shapes


@pytest.fixture
def mesh_file(tmp_path):
    path = tmp_path / "spheroid.obj"
    shapes.add_normal_noise(shapes.ellipsoid(4), 0.05, seed=0).save(path)
    return path


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_fields_prints_a_table_and_writes_files(mesh_file, capsys):
    code = cli.main(["fields", str(mesh_file), "-k", "4", "-o", "fields.npz", "--no-picture"])
    printed = capsys.readouterr().out
    assert code == 0
    assert "λ·area" in printed and "multiplicity" in printed and "162 vertices, 320 faces" in printed
    with np.load("fields.npz") as saved:
        assert saved["eigenvalues"].shape == (4,) and saved["vectors"].shape == (4, 162, 3)


def test_fields_as_json(mesh_file, capsys):
    assert cli.main(["fields", str(mesh_file), "-k", "3", "--json", "--no-picture"]) == 0
    report = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(
        np.array(report["eigenvalues"]) * report["area"], report["eigenvalues_times_area"], rtol=1e-12
    )
    assert report["vertices"] == 162 and len(report["residuals"]) == 3 and report["picture"] is None


@pytest.mark.slow
def test_symmetrize_writes_a_symmetric_mesh_and_a_picture(mesh_file, capsys):
    arguments = ["-o", "out.ply", "--json", "--picture", "out.png", "--changes", "changes.ply"]
    code = cli.main(["symmetrize", str(mesh_file), *arguments])
    report = json.loads(capsys.readouterr().out)
    assert code == 0 and report["result"] == "successful"
    before, after = (report[when]["eigenvalues_times_area"][0] for when in ("before", "after"))
    assert after <= 20 / report["before"]["faces"] ** 2 + 1e-6 * before < 0.1 * before
    mesh = TriangleMesh.load("out.ply")
    np.testing.assert_array_equal(mesh.faces, TriangleMesh.load(mesh_file).faces)
    assert Path("out.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert report["history"][0][0] == pytest.approx(before)
    assert report["exact_fields"] == {"before": 0, "after": 1} and report["flipped_faces"] == 0
    moved = report["displacement_in_mean_edges"]
    assert 0 < moved["rms"] < moved["largest"]
    assert report["most_changed_faces"][0]["stretch"] >= report["most_changed_faces"][1]["stretch"] > 1
    colored = TriangleMesh.load("changes.ply")
    np.testing.assert_allclose(colored.vertices, mesh.vertices, rtol=1e-12)
    assert b"property uchar red" in Path("changes.ply").read_bytes()


def test_what_cannot_be_done_says_why_and_exits_1(mesh_file, tmp_path, capsys):
    broken = tmp_path / "broken.obj"
    broken.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 7\n")
    for arguments, message in (
        (["fields", "nowhere.obj"], "nowhere.obj"),
        (["fields", str(broken)], "broken.obj"),
        (
            ["fields", str(mesh_file), "-k", "1000"],
            "k must be an integer between 1 and the number of unknowns 324",
        ),
        (["fields", str(mesh_file), "-o", "no/such/place.npz"], "the folder"),
        (["symmetrize", str(mesh_file), "-o", "no/such/place.obj"], "the folder"),
    ):
        assert cli.main([*arguments, "--no-picture"]) == 1
        error = capsys.readouterr().err
        assert error.startswith("jaxkvf: ") and message in error and "Traceback" not in error
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_file()) == ["broken.obj", "spheroid.obj"]


def test_a_failing_solver_speaks_in_one_sentence(mesh_file, monkeypatch, capsys):
    """Not with the stacks of compiled code."""

    def fail(*arguments, **options):
        mesh = shapes.icosphere(1)
        return killing_fields(mesh.with_vertices(mesh.vertices * np.nan), 1)

    monkeypatch.setattr("jaxkvf.cli._fields.killing_fields", fail)
    assert cli.main(["fields", str(mesh_file), "--no-picture"]) == 1
    error = capsys.readouterr().err
    assert (
        error.startswith("jaxkvf: The matrices of the eigenproblem hold NaN or infinity")
        and "JIT" not in error
    )


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["nonsense"],
        ["fields"],
        ["fields", "x.obj", "-k", "0"],
        ["fields", "x.obj", "-k", "many"],
        ["fields", "x.obj", "--discretization", "fem"],
        ["symmetrize", "x.obj"],
        ["symmetrize", "x.obj", "-o", "out.docx"],
        ["fields", "x.obj", "--picture", "out.jpg"],
    ],
    ids=" ".join,
)
def test_wrong_use_exits_2(arguments, capsys):
    with pytest.raises(SystemExit) as stopped:
        cli.main(arguments)
    assert stopped.value.code == 2
    assert "usage: jaxkvf" in capsys.readouterr().err


def test_without_rich_it_says_what_to_install(mesh_file, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rich.console", None)
    assert cli.main(["fields", str(mesh_file)]) == 1
    assert 'pip install "jaxkvf[cli]"' in capsys.readouterr().err


def test_a_picture_that_cannot_be_drawn_does_not_lose_the_result(mesh_file, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "polyscope", None)
    assert cli.main(["fields", str(mesh_file), "-k", "2", "-o", "kept.npz"]) == 0
    assert "no picture" in capsys.readouterr().out
    assert Path("kept.npz").exists()
    assert cli.main(["fields", str(mesh_file), "-k", "2", "--picture", "asked.png"]) == 1
    assert "jaxkvf[viz]" in capsys.readouterr().err


def test_it_runs_as_a_program(mesh_file):
    ran = subprocess.run(
        [sys.executable, "-m", "jaxkvf.cli", "fields", str(mesh_file), "-k", "2", "--no-picture"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert "λ·area" in ran.stdout
