"""One manner for the public API: the table in docs/conventions.md is what the signatures say.

`python tests/test_conventions.py` prints the table as it is now.
"""

import inspect
import re
from pathlib import Path

import jaxkvf
from jaxkvf import eigen, flows, geometry, patterns, reference, report, symmetrization, viz
from jaxkvf.mesh import shapes

DOCUMENT = Path(__file__).parents[1] / "docs" / "conventions.md"
ROOMS = (jaxkvf, eigen, flows, geometry, patterns, reference, report, symmetrization, viz, shapes)
WRITERS = ("save_", "write_", "render", "plot_")


def functions() -> dict[str, object]:
    """Every public function under the shortest name that it is imported by."""
    found: dict[int, tuple[str, object]] = {}
    for room in ROOMS:
        prefix = room.__name__.replace("jaxkvf.mesh.shapes", "shapes").removeprefix("jaxkvf").lstrip(".")
        for name, value in sorted(vars(room).items()):
            is_ours = getattr(value, "__module__", "").startswith("jaxkvf")
            if not name.startswith("_") and is_ours and callable(value) and not inspect.isclass(value):
                found.setdefault(id(value), (f"{prefix}.{name}".lstrip("."), value))
    return dict(sorted(found.values()))


def signature(function: object) -> tuple[str, str]:
    """Arguments, with a star before those by name only, and what is returned, without the shapes."""
    shown, starred = [], False
    told = inspect.signature(inspect.unwrap(function))
    for name, parameter in told.parameters.items():
        stars = {parameter.VAR_POSITIONAL: "\\*", parameter.VAR_KEYWORD: "\\*\\*"}.get(parameter.kind, "")
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            shown.append("\\*")
        starred |= parameter.kind in {parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL}
        default = parameter.default
        given = repr(default) if isinstance(default, str | int | bool) else "…"
        shown.append(f"{stars}{name}" + ("" if default is parameter.empty else f"={given}"))
    return ", ".join(shown), returned(told.return_annotation)


def returned(kind: object) -> str:
    if kind is None:
        return "nothing"
    text = kind if isinstance(kind, str) else getattr(kind, "__name__", str(kind))
    if hasattr(kind, "__args__") and not hasattr(kind, "dtypes"):
        text = str(kind)
    text = re.sub(r"jaxkvf(\.\w+)*\.|jaxtyping\.|numpy\.|jaxlib\._jax\.|typing\.|pathlib\.", "", text)
    text = re.sub(r"<class '([^']*)'>", r"\1", text)
    text = text.replace("ndarray", "np.ndarray")
    return text.replace("|", "or")


def table() -> str:
    rows = ["| Function | Arguments | Returns |", "| --- | --- | --- |"]
    for name, function in functions().items():
        arguments, result = signature(function)
        rows.append(f"| `{name}` | {arguments} | {result} |")
    return "\n".join(rows)


def test_the_table_is_what_the_signatures_say():
    written = DOCUMENT.read_text(encoding="utf-8")
    assert table() in written, "python tests/test_conventions.py prints the table as it is now"


def test_a_path_comes_first_in_every_writer():
    for name, function in functions().items():
        last = name.rpartition(".")[2]
        if last.startswith(WRITERS):
            assert next(iter(inspect.signature(inspect.unwrap(function)).parameters)) == "path", name


def test_times_periods_and_tolerances_have_one_name():
    for name, function in functions().items():
        parameters = inspect.signature(inspect.unwrap(function)).parameters
        wrong = {"tol", "eps", "max_iter", "maxiter", "max_iterations", "T"} & set(parameters)
        assert not wrong, (name, wrong)


if __name__ == "__main__":
    print(table())
