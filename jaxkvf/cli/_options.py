"""Options that several commands share, and what they accept: each is declared here once."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

READABLE = ".obj, .ply, .off or .stl"
WRITABLE = (".obj", ".ply", ".off", ".stl")


def positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {number}")
    return number


def count(text: str) -> int:
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"must be at least 0, got {number}")
    return number


def finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"must be finite, got {text}")
    return number


def with_suffix(*suffixes: str) -> Callable[[str], Path]:
    def path(text: str) -> Path:
        if Path(text).suffix.lower() not in suffixes:
            raise argparse.ArgumentTypeError(f"must end in {' or '.join(suffixes)}, got {text!r}")
        return Path(text)

    return path


def add_mesh(command: argparse.ArgumentParser) -> None:
    command.add_argument("mesh", type=Path, metavar="MESH", help=f"a {READABLE} file")


def add_output(
    command: argparse.ArgumentParser, *suffixes: str, metavar: str, text: str, required: bool = False
) -> None:
    command.add_argument(
        "-o", "--output", type=with_suffix(*suffixes), metavar=metavar, required=required, help=text
    )


def add_solve(command: argparse.ArgumentParser) -> None:
    """`-k` and `--discretization`: which fields, by which operator."""
    command.add_argument("-k", type=positive, default=6, help="number of fields (default: 6)")
    command.add_argument("--discretization", choices=("regge", "regge-delaunay", "dec"), default="regge")


def add_count(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--count", type=positive, default=1, help="number of symmetries to make exact (default: 1)"
    )


def add_json(command: argparse.ArgumentParser) -> None:
    command.add_argument("--json", action="store_true", help="print the result as JSON")


def add_up(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--up",
        choices=("auto", "x", "y", "z"),
        default="auto",
        help="what is up in the picture (default: the axis of symmetry; y where there is none)",
    )


def add_picture(command: argparse.ArgumentParser) -> None:
    """`--picture`, `--no-picture` and `--up` of the commands that draw a picture beside their result."""
    add_up(command)
    picture = command.add_mutually_exclusive_group()
    picture.add_argument(
        "--picture", type=with_suffix(".png"), metavar="PNG", help="where to put the picture"
    )
    picture.add_argument("--no-picture", action="store_true", help="draw nothing")
