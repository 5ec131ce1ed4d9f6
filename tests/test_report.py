"""HTML reports: what is in the page, what the command says, and how it behaves in a browser."""

import base64
import json
import os
import re
import shutil
import sys
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf import KillingFields, TriangleMesh, cli, shapes
from jaxkvf.eigen import RESULTS
from jaxkvf.flows import Period
from jaxkvf.geometry import barycentric_vertex_areas, edge_lengths, surface_area
from jaxkvf.report import Contents, FlowLines, contents, write_report
from jaxkvf.report._page import page, three_js


def about_z(mesh: TriangleMesh) -> Contents:
    """A report's contents for two fields known in closed form: the turn about z, and z times it."""
    x = np.asarray(mesh.vertices)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    area = float(surface_area(lengths, mesh.topology))
    weights = np.asarray(barycentric_vertex_areas(lengths, mesh.topology))
    turn = np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)
    fields = np.stack([turn, x[:, 2:] * turn])
    fields /= np.sqrt((weights * (fields**2).sum(axis=2)).sum(axis=1))[:, None, None]
    two = jnp.arange(2.0)
    found = KillingFields(
        two,
        jnp.asarray(fields),
        jnp.zeros((2, 4)),
        two,
        jnp.arange(2),
        jnp.asarray(area),
        jnp.ones(2, bool),
        RESULTS.successful,
        {},
        "made by hand",
    )
    some = np.ones(4)
    closed = Period(3.0, 0.0, 0, some, some, 0 * some, some > 0, np.arange(4), np.zeros(4, int))
    lines = FlowLines(
        x[np.asarray(mesh.faces)[:5]],
        np.arange(5)[:, None] + np.zeros((1, 3), int),
        np.full(5, 3),
        np.full(5, 3.0),
    )
    return Contents(mesh, found, np.ones((2, 1)), np.abs(fields).sum(axis=2), (closed, None), (lines, lines))


def data_of(text: str) -> dict:
    (found,) = re.findall(r'<script id="data" type="application/json">(.*?)</script>', text, re.S)
    return json.loads(found)


def decoded(text: str, dtype: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype)


def test_the_page_holds_the_contents():
    before, after = about_z(shapes.icosphere(3)), about_z(shapes.ellipsoid(3))
    text = page((before, after), three_js(), title="</script><b>&", up="z")
    assert "<b>&" not in text and "http://" not in text.replace("http://www.w3.org/", "")
    data = data_of(text)
    np.testing.assert_array_equal(decoded(data["faces"], "<u4").reshape(-1, 3), np.asarray(before.mesh.faces))
    for told, surface in zip((before, after), data["surfaces"], strict=True):
        vertices = decoded(surface["vertices"], "<f4").reshape(-1, 3)
        np.testing.assert_allclose(vertices, np.asarray(told.mesh.vertices), atol=1e-6)
        root = np.sqrt(float(told.fields.area))
        for i, field in enumerate(surface["fields"]):
            most, parts = field["vectors"]["most"], decoded(field["vectors"]["parts"], "<i2")
            wanted = root * np.asarray(told.fields.vectors[i])
            np.testing.assert_allclose(parts.reshape(-1, 3) * most / 32767, wanted, atol=most / 32767)
            lines = field["lines"]
            points = (
                decoded(lines["positions"], "<u2").reshape(-1, 3) / 65535 * lines["reach"] + lines["origin"]
            )
            wanted = told.lines[i].positions.reshape(-1, 3)
            assert np.abs(points - wanted).max() < 0.002 * lines["reach"]
        assert surface["fields"][0]["period"]["time"] == 3.0 and surface["fields"][1]["period"] is None
        assert surface["facts"]["boundary loops"] == 0 and surface["facts"]["vertices"] == 92
    moved = np.linalg.norm(np.asarray(after.mesh.vertices - before.mesh.vertices), axis=1)
    shown = decoded(data["displacement"]["parts"], "<i2") * data["displacement"]["most"]
    assert np.corrcoef(shown, moved)[0, 1] > 1 - 1e-6


def test_what_cannot_be_done_says_why(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    mesh, file = shapes.icosphere(2), tmp_path / "sphere.obj"
    mesh.save(file)
    with pytest.raises(ValueError, match=r"written as \.html"):
        write_report(tmp_path / "page.pdf", mesh)
    with pytest.raises(ValueError, match="same mesh"):
        write_report(tmp_path / "page.html", mesh, symmetrized=shapes.icosphere(3))
    with pytest.raises(ValueError, match="up must be"):
        write_report(tmp_path / "page.html", mesh, up="w")
    for arguments, message in (
        (["nowhere.obj", "-o", "page.html"], "nowhere.obj"),
        ([str(file), "-o", "no/such/page.html"], "the folder"),
        ([str(file), "-o", str(tmp_path / "page.html"), "-k", "1000"], "k must be an integer between 1 and"),
    ):
        assert cli.main(["report", *arguments]) == 1
        error = capsys.readouterr().err
        assert error.startswith("jaxkvf: ") and message in error and "Traceback" not in error
    for arguments in ([], [str(file)], [str(file), "-o", "page.htm"], [str(file), "-o", "p.html", "-k", "0"]):
        with pytest.raises(SystemExit) as stopped:
            cli.main(["report", *arguments])
        assert stopped.value.code == 2
    monkeypatch.setitem(sys.modules, "jupyter_threejs_sage", None)
    assert cli.main(["report", str(file), "-o", str(tmp_path / "page.html")]) == 1
    assert 'pip install "jaxkvf[report]"' in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()


def with_speck(main: TriangleMesh, size: float) -> TriangleMesh:
    """The mesh and beside it a closed tetrahedron of another size."""
    x = np.concatenate([main.vertices, size * np.vstack([np.zeros(3), np.eye(3)]) + 5.0])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]) + len(main.vertices)
    return TriangleMesh.from_arrays(x, np.concatenate([main.faces, faces]))


@pytest.mark.slow
def test_specks_take_no_time_and_few_curves():
    """Curves around a speck a thousandth as large go round it a million times while those of the rest go round once."""
    mesh = with_speck(shapes.cylinder(12), 1e-3)
    contents(mesh, 6)  # compiles
    start = time.perf_counter()
    told = contents(mesh, 6)
    assert time.perf_counter() - start < 20
    on_speck = told.shares[:, 1] > 0.5
    assert on_speck.any() and not on_speck.all()
    label = mesh.topology.components()[1][np.asarray(mesh.faces)[:, 0]]
    for alone, lines in zip(on_speck, told.lines, strict=True):
        here = label[lines.faces[:, 0]]
        assert len(lines.counts) > 0 and (lines.counts > 1).all()
        if alone:
            assert len(here) <= 8
        for component in np.unique(
            here
        ):  # as far as half around a sphere of this area, not a thousand times around
            x = lines.positions[here == component]
            gone = np.linalg.norm(np.diff(x, axis=1), axis=2).sum(axis=1)
            assert gone.max() < 10 * np.ptp(x.reshape(-1, 3), axis=0).max()


@pytest.mark.slow
def test_contents_are_those_of_the_fields():
    mesh = shapes.ellipsoid(6)
    told = contents(mesh, 2)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    energies = told.strains**2 @ np.asarray(barycentric_vertex_areas(lengths, mesh.topology))
    np.testing.assert_allclose(energies, told.fields.eigenvalues, rtol=1e-6, atol=1e-12)
    x, (turning, _) = np.asarray(mesh.vertices), told.lines
    assert told.periods[0] is not None and (turning.durations == told.periods[0].period).all()
    start, end = turning.positions[:, 0], turning.positions[:, -1]
    assert np.linalg.norm(end - start, axis=1).max() < 0.1 * float(lengths.mean())
    starts = np.sort(start[:, 2])
    assert len(starts) > 4 and np.diff(starts).min() > 0.02  # circles apart from each other
    assert np.abs(turning.positions[..., 2] - start[:, None, 2]).max() < 0.03 * np.ptp(x[:, 2])


@pytest.fixture(scope="module")
def report_file(tmp_path_factory) -> Path:
    """Written by the command, of a noisy spheroid and its symmetrized twin."""
    folder = tmp_path_factory.mktemp("report")
    shapes.add_normal_noise(shapes.ellipsoid(6), 0.15, seed=0).save(folder / "spheroid.obj")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        arguments = [
            str(folder / "spheroid.obj"),
            "-o",
            str(folder / "report.html"),
            "-k",
            "3",
            "--symmetrize",
        ]
        assert cli.main(["report", *arguments]) == 0
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Headless Chromium that renders WebGL in software."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        reason = "no Chromium: bash .ci/system-packages --browser"
        pytest.fail(reason) if os.environ.get("CI") == "true" else pytest.skip(reason)
    from selenium import webdriver  # noqa: PLC0415

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for argument in (
        "headless",
        "no-sandbox",
        "disable-gpu",
        "use-angle=swiftshader",
        "enable-unsafe-swiftshader",
        "disable-dev-shm-usage",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
        "no-first-run",
        "force-prefers-reduced-motion",  # pages start at rest: software draws two frames a second
        "window-size=900,500",
        f"user-data-dir={tmp_path_factory.mktemp('profile')}",
    ):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    driver.set_script_timeout(30)
    yield driver
    driver.quit()


def picture(browser) -> np.ndarray:
    """The canvas once the page has drawn what was asked of it."""
    import io  # noqa: PLC0415

    from PIL import Image  # noqa: PLC0415

    browser.execute_async_script(
        "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done)));"
    )
    shot = browser.find_element("id", "view").screenshot_as_png
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), float)


def choose(browser, control: str, value: str) -> None:
    from selenium.webdriver.support.select import Select  # noqa: PLC0415

    Select(browser.find_element("id", control)).select_by_value(value)


@pytest.mark.slow
def test_in_a_browser(report_file, browser):
    browser.get(report_file.as_uri())
    assert browser.execute_script("return document.documentElement.dataset.ready") == "yes"
    still = picture(browser)
    np.testing.assert_array_equal(picture(browser), still)
    flow = "document.getElementById('play').checked = arguments[0]"
    browser.execute_script(flow, True)
    picture(browser)
    browser.execute_script(flow, False)
    moved, still = still, picture(browser)
    assert (moved != still).any()
    halves = np.split(still[:, : still.shape[1] // 2 * 2], 2, axis=1)
    assert all(len(np.unique(half.reshape(-1, 3), axis=0)) > 500 for half in halves)  # a surface in each

    def changed(share: float) -> None:
        nonlocal still
        now = picture(browser)
        assert (np.abs(now - still).max(axis=2) > 8).mean() > share
        still = now

    for field in ("1", "2"):
        choose(browser, "field", field)
        changed(0.05)
    browser.find_elements("css selector", "#numbers tbody tr")[0].click()
    changed(0.05)
    assert browser.find_element("id", "field").get_attribute("value") == "0"
    for control, value in (
        ("draw", "arrows"),
        ("draw", "nothing"),
        ("color", "strain"),
        ("color", "displacement"),
        ("up", "x"),
    ):
        choose(browser, control, value)
        changed(0.005)
    from selenium.webdriver import ActionChains  # noqa: PLC0415
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin  # noqa: PLC0415

    canvas = browser.find_element("id", "view")
    ActionChains(browser).drag_and_drop_by_offset(canvas, 80, 30).perform()
    changed(0.02)
    ActionChains(browser).scroll_from_origin(ScrollOrigin.from_element(canvas), 0, -300).perform()
    changed(0.02)

    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
    urls = {
        p["request"]["url"] for p in asked if p["documentURL"] == report_file.as_uri()
    }  # not its own new tab's
    assert report_file.as_uri() in urls
    assert {url.partition(":")[0] for url in urls} <= {"file", "data"}
    said = [
        entry for entry in browser.get_log("browser") if "GPU stall due to ReadPixels" not in entry["message"]
    ]
    assert said == []
    text = browser.find_element("tag name", "aside").text
    assert "362 vertices" in text and "closed" in text and "1 continuous symmetry" in text
