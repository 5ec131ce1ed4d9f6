"""The documentation site says what is true of the code: its error messages exist, its pages and pictures are there."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))


@pytest.fixture(scope="module")
def texts_in_the_code():
    """Every string in the sources but docstrings, f-strings with their values left out."""
    found = []
    for source in (ROOT / "jaxkvf").rglob("*.py"):
        nodes = list(ast.walk(ast.parse(source.read_text(encoding="utf-8"))))
        prose = {node.value for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in prose:
                found.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                found.append("".join(str(getattr(part, "value", "")) for part in node.values))
    return found


def test_error_messages_are_those_of_the_code(texts_in_the_code):
    headings = re.findall(r"^### `(.*)`$", (ROOT / "docs/errors.md").read_text(encoding="utf-8"), re.M)
    assert len(headings) > 20
    missing = [heading for heading in headings if not any(heading in text for text in texts_in_the_code)]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT / "docs").as_posix())
def test_scripts_and_snippets_that_pages_name_exist(page):
    text = page.read_text(encoding="utf-8")
    for script in re.findall(
        r"`(?:python |bash )?((?:benchmarks|tests|notebooks|\.ci|jaxkvf)/[\w./-]+)", text
    ):
        assert (ROOT / script).exists(), script
    for file, section in re.findall(r'^--8<-- "(\S+?):(\w+)"', text, re.M):
        marked = (ROOT / file).read_text(encoding="utf-8")
        assert f"[start:{section}]" in marked and f"[end:{section}]" in marked, (file, section)


def test_every_public_name_is_in_the_api_reference():
    """The pages of subpackages list what these export; what comes from single modules is listed by hand."""
    exports = re.findall(r"^from \.(\w+) import (\w+)", (ROOT / "jaxkvf/__init__.py").read_text(), re.M)
    pages = "\n".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs/api").glob("*.md"))
    listed = set(re.findall(r"^::: jaxkvf\.(\w+)$", pages, re.M))
    assert exports and not [name for module, name in exports if module not in listed and name not in listed]


def test_pictures_are_small():
    for picture in (ROOT / "docs/gallery").glob("*.png"):
        assert picture.stat().st_size <= 120_000, picture.name
