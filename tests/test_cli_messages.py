"""What the command line says when something goes wrong: in its own words, without another library's advice."""

import re
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf import TriangleMesh, cli, shapes
from jaxkvf.cli._messages import spoken
from jaxkvf.eigen import RESULTS
from jaxkvf.symmetrization import OUTCOMES

COMMAND = re.compile(r"`(?:jaxkvf |--)[^`]*`")
PYTHON_ONLY = re.compile(
    r"`|\w=\w|\bthrow\b|max_steps|resume|ScipyEigsh|DenseEigh|minimiser`|preconditioner|float64|"
    r"Traceback|EQX_|JAX_|jax\.|equinox"
)


MESSAGES = [
    pytest.param(kind[item], id=f"{kind.__name__}.{name}")
    for kind in (RESULTS, OUTCOMES)
    for name, item in kind._name_to_item.items()
    if name != "successful"
]


@pytest.mark.parametrize("message", MESSAGES)
def test_outcomes_name_no_python_and_say_what_to_do(message):
    said = spoken(message)
    assert not PYTHON_ONLY.search(COMMAND.sub("", said)), said
    assert said.split(". ")[0].rstrip(".") == message.split(". ")[0].split(":")[0].replace("`", "").rstrip(
        "."
    ) or (said.startswith(message.split(" ", 3)[0]))
    assert re.search(r"--[a-z]|`jaxkvf ", said), said


@pytest.mark.parametrize(
    ("library", "said"),
    [
        (
            "two sheets touch in vertex 7: repair(…, split_nonmanifold=True)",
            "two sheets touch in vertex 7: `jaxkvf repair MESH -o OUT --split-nonmanifold`",
        ),
        (
            "cracks; repair(…, merge_duplicates=1.5e-07, orient=True) closes them",
            "cracks; `jaxkvf repair MESH -o OUT --merge-duplicates 1.5e-07 --orient` closes them",
        ),
        ("k must be an integer of at least 1, got 0", "k must be an integer of at least 1, got 0"),
    ],
)
def test_calls_of_repair_become_commands(library, said):
    assert spoken(ValueError(library)) == said


def failing(x, compile_with):
    @compile_with
    def checked(x):
        return eqx.error_if(
            x, x > 0, "The matrices of the eigenproblem hold NaN or infinity. Check the positions."
        )

    return checked(x).block_until_ready()


@pytest.mark.parametrize("compile_with", [eqx.filter_jit, jax.jit, lambda f: f])
def test_errors_of_compiled_programs_are_one_sentence_and_a_remedy(compile_with):
    with pytest.raises(RuntimeError) as caught:
        failing(jnp.ones(()), compile_with)
    said = spoken(caught.value)
    assert said.startswith("The matrices of the eigenproblem hold NaN or infinity. `jaxkvf check MESH`")
    assert "\n" not in said and not PYTHON_ONLY.search(COMMAND.sub("", said))


def test_an_error_inside_a_callback_is_what_was_raised():
    def fail(x):
        raise ValueError("the factor is singular")

    @jax.jit
    def called(x):
        return jax.pure_callback(fail, jax.ShapeDtypeStruct((), x.dtype), x)

    with pytest.raises(RuntimeError) as caught:
        called(jnp.ones(())).block_until_ready()
    assert spoken(caught.value) == "the factor is singular"


def boxes(tmp_path):
    """A sphere, and another one beside it."""
    x, f = (np.asarray(a) for a in (shapes.icosphere(3).vertices, shapes.icosphere(3).faces))
    both = TriangleMesh.from_arrays(np.concatenate([x, 2 * x + 9]), np.concatenate([f, f + len(x)]))
    both.save(tmp_path / "two.obj")
    return tmp_path / "two.obj"


def test_fields_say_on_which_component_they_live(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = boxes(tmp_path)
    assert cli.main(["fields", str(path), "-k", "10", "--no-picture"]) == 0
    printed = capsys.readouterr().out
    assert "component" in printed
    rows = [line for line in printed.splitlines() if line.startswith("│")]
    homes = [row.split("│")[-2].strip() for row in rows]
    assert homes[6:9] == ["1", "1", "1"]  # 4 of the larger sphere, a quarter of the smaller one's
    assert set(homes[:6]) <= {"0", "1", "0, 1", "1, 0"}


def test_a_program_that_fails_prints_its_message_and_nothing_else(tmp_path):
    path = tmp_path / "spike.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1e-320\nf 1 2 3\nf 2 4 3\nf 1 2 9\n")
    ran = subprocess.run(
        [sys.executable, "-m", "jaxkvf.cli", "fields", str(path), "--no-picture"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 1 and ran.stdout == ""
    assert ran.stderr.startswith("jaxkvf: ") and ran.stderr.count("\n") == 1
    assert not PYTHON_ONLY.search(COMMAND.sub("", ran.stderr))


def test_a_zero_of_the_coarseness_is_said_to_be_one(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    corners = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    sides = (
        "1 2 4",
        "1 4 3",
        "5 8 6",
        "5 7 8",
        "1 6 2",
        "1 5 6",
        "3 4 8",
        "3 8 7",
        "1 3 7",
        "1 7 5",
        "2 8 4",
        "2 6 8",
    )
    (tmp_path / "cube.obj").write_text("\n".join([*corners, *(f"f {side}" for side in sides)]))
    assert cli.main(["fields", str(tmp_path / "cube.obj"), "-k", "4", "--no-picture"]) == 0
    assert capsys.readouterr().out.count("(too coarse") == 3
