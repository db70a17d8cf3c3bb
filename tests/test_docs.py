"""The documentation is what its builder writes today."""

from __future__ import annotations

import importlib.util
import re

import numpy as np
from conftest import ROOT, SHIPPED

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")


def builder():
    spec = importlib.util.spec_from_file_location("build_docs", ROOT / "docs" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_gallery_is_up_to_date():
    written, now = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"), builder().page()
    assert NUMBER.sub("#", written) == NUMBER.sub("#", now), "run `make docs`"
    numbers = [np.array(NUMBER.findall(page), dtype=float) for page in (written, now)]
    np.testing.assert_allclose(*numbers, rtol=2e-3, atol=1e-9, err_msg="run `make docs`")


def test_the_page_of_the_elements_is_up_to_date():
    assert (ROOT / "docs" / "elements.md").read_text(encoding="utf-8") == builder().elements_page(), "run `make docs`"


def test_every_model_that_ships_has_its_figure():
    assert SHIPPED
    for path in SHIPPED:
        assert (ROOT / "docs" / f"{path.stem}.png").stat().st_size > 5_000


def test_the_figures_of_the_paper_are_shown_with_their_verdicts():
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    assert page.startswith(builder().PAPER)
    assert page.count("99 % limits by control variates") == 4
    for number in builder().FIGURES:
        assert f"](figure_{number}.png)" in page
        assert (ROOT / "docs" / f"figure_{number}.png").stat().st_size > 20_000
