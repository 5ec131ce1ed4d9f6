"""The notebook runs, and shows what it says."""

import json
from pathlib import Path

import numpy as np
import pytest

NOTEBOOK = Path(__file__).resolve().parents[1] / "notebooks" / "pipeline.ipynb"


@pytest.mark.slow
def test_the_belief_in_a_symmetry_helps(capsys):
    """The axis is found, λ₀·area falls, and the shape is nearer to the truth than without."""
    names = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    decode, truth, fit = names["decode"], names["truth"], names["fit"]
    without = fit(0.0)

    def error(theta):
        return float(np.sqrt(((decode(theta) - truth) ** 2).sum(axis=1).mean()))

    assert error(names["theta"]) < error(without)
    assert names["asymmetry"](decode(names["theta"])) < 0.5 * names["asymmetry"](decode(without))
    assert np.abs(names["found"]) @ np.asarray(names["axis"]) > 0.998
    assert "relative difference from finite differences" in capsys.readouterr().out
