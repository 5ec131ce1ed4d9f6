"""`jaxkvf check` and `jaxkvf repair` as their user meets them."""

import json

import numpy as np
import pytest

from jaxkvf import TriangleMesh, cli, shapes


@pytest.fixture
def soup(tmp_path, monkeypatch):
    """A sphere of separate triangles, one of them turned over and one NaN vertex."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    mesh = shapes.icosphere(2)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)].reshape(-1, 3)
    lines = [f"{x!r} {y!r} {z!r}" for x, y, z in corners.tolist()] + ["0 0 nan"]
    faces = [f"3 {3 * f} {3 * f + 1} {3 * f + 2}" for f in range(79)] + ["3 239 238 237"]
    path = tmp_path / "soup.off"
    path.write_text("\n".join(["OFF", f"{len(lines)} 80 0", *lines, *faces]))
    return path


def test_check_lists_and_repair_mends(soup, capsys):
    assert cli.main(["check", str(soup)]) == 1
    printed = capsys.readouterr().out
    assert "cannot be used as it is" in printed and "1 positions that are not finite (vertex 240)" in printed
    assert cli.main(["check", str(soup), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert not report["ok"] and report["errors"][0]["first"] == [240]

    assert cli.main(["repair", str(soup), "-o", "out.ply", "--orient", "--drop-invalid"]) == 0
    assert TriangleMesh.load("out.ply").topology.components()[0] == 80
    assert cli.main(["repair", str(soup), "-o", "out.ply", "--all", "--json"]) == 0
    done = json.loads("{" + capsys.readouterr().out.partition("{")[2])
    assert "turned faces over: 1" in done["actions"] and done["written"] == "out.ply"
    assert TriangleMesh.load("out.ply").topology.euler_characteristic == 2
    assert cli.main(["check", "out.ply"]) == 0
    assert cli.main(["repair", str(soup), "-o", "none.ply", "--orient"]) == 1
    assert not soup.with_name("none.ply").exists()
