"""Messages of the library in the words of the command line, whose user has no Python to change."""

import re

_CALL = re.compile(r"repair\(…, ([^)]*)\)")
_PYTHON = re.compile(
    r"`(?!jaxkvf )[^`]*`|\b(ScipyEigsh|DenseEigh|LOBPCG|preconditioner|float64|minimiser|from_arrays)\b"
)
_RAISED = re.compile(r"^(?:[\w.]+\.)?\w*(?:Error|Exception): (.*)$", re.MULTILINE)

_SOLVER = (
    "`jaxkvf check MESH` tells whether thin triangles or small loose pieces are the reason: "
    "`--discretization regge-delaunay` bears thin triangles, `jaxkvf repair MESH -o OUT --keep-largest 1` drops pieces."
)
_CHECK = "`jaxkvf check MESH` names what is wrong with the mesh."
_REMEDIES = {
    "The eigensolver stopped at its maximum number of steps": _SOLVER,
    "The residuals stopped falling": _SOLVER,
    "The matrices of the eigenproblem hold NaN": _CHECK,
    "B is not positive definite": "Use `--discretization regge`.",
    "A is declared positive semi-definite": _CHECK,
    "The minimiser came to rest": "Ask for fewer symmetries (`--count`), or accept the mesh as it is.",
    "The vertices moved as far as": "Ask for fewer symmetries (`--count`), or accept the mesh as it is.",
    "The maximum number of": "Raise `--max-steps`.",
    "The eigensolver failed on the input mesh": "`jaxkvf fields MESH` says why.",
    "λ·area came out below zero": _CHECK,
    "The minimiser arrived at a mesh": "`jaxkvf check MESH` tells whether triangles are too thin.",
}
"""What to do on the command line, by how the message begins."""


def spoken(message: object) -> str:
    """What an error or a warning says: without stacks and advice for debugging, with remedies that the command line has."""
    text = str(message).strip() or type(message).__name__
    text = text.rpartition("EquinoxRuntimeError: ")[2].split("\n\n")[0]
    if "Traceback (most recent call last)" in text:
        text = _RAISED.findall(text)[-1]
    text = as_options(text)
    remedy = next((remedy for start, remedy in _REMEDIES.items() if text.startswith(start)), None)
    if remedy is None:
        return text
    sentences = re.split(r"(?<=[.:]) (?=[A-Z`])", text)
    kept = [sentence for sentence in sentences[1:] if not _PYTHON.search(sentence)]
    first = _plain(sentences[0])
    return " ".join([first, *(sentence for sentence in kept if not _advises(sentence)), remedy])


def as_options(text: str) -> str:
    """A message in which calls of `repair` are commands: `repair(…, orient=True)` is `jaxkvf repair … --orient`."""

    def command(call: re.Match[str]) -> str:
        steps = [argument.partition("=") for argument in call[1].split(", ")]
        given = [
            f"--{name.replace('_', '-')}" + ("" if value == "True" else f" {value}")
            for name, _, value in steps
        ]
        return "`jaxkvf repair MESH -o OUT " + " ".join(given) + "`"

    return _CALL.sub(command, text)


def _advises(sentence: str) -> bool:
    """Whether it says what to do: the command line's remedy stands for it."""
    return sentence.startswith(("Raise", "Lower", "Loosen", "Use", "Pass", "Check", "Ask"))


def _plain(sentence: str) -> str:
    return re.sub(r"`(?!jaxkvf )([^`]*)`", r"\1", sentence)
