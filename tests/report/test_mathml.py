"""Formulas have one notation, which Typst and the HTML page set alike; what the page cannot read is refused."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from harness.errors import HarnessError
from harness.report.pages.mathml import mathml
from harness.report.texts import FOLDER, read


def formulas() -> list[str]:
    """Every formula of the texts."""
    return [block["formula"] for path in sorted(FOLDER.glob("*.toml")) for block in read(path.name).get("block", ())
            if "formula" in block]


def test_every_formula_of_the_report_is_well_formed_and_keeps_its_letters() -> None:
    assert len(formulas()) >= 10
    for source in formulas():
        text = "".join(ET.fromstring(mathml(source)).itertext())
        assert not {"alpha", "pi", "bold", "thin", "sum", "frac", "_", "^", '"'} & set(text.split()), source
        assert all(letter in text for letter in source if letter in "=+")


@pytest.mark.parametrize(("source", "wanted"), [
    ("a / (b + 1)", "<mfrac><mrow><mi>a</mi></mrow><mrow><mi>b</mi><mo>+</mo><mn>1</mn></mrow></mfrac>"),
    ("x_i^2", "<msubsup><mrow><mi>x</mi></mrow><mrow><mi>i</mi></mrow><mrow><mn>2</mn></mrow></msubsup>"),
    ("(a)", "<mrow><mo>(</mo><mi>a</mi><mo>)</mo></mrow>"),
    ("sqrt(N)", "<mrow><msqrt><mi>N</mi></msqrt></mrow>"),
    ('p_"met" dot alpha', "<msub><mrow><mi>p</mi></mrow><mrow><mtext>met</mtext></mrow></msub><mo>⋅</mo><mi>α</mi>")])
def test_a_formula_becomes_mathml(source: str, wanted: str) -> None:
    assert mathml(source) == f'<math display="block">{wanted}</math>'


def test_a_sum_has_its_bounds_below_and_above() -> None:
    assert "<munderover><mrow><mo>∑</mo></mrow><mrow><mi>i</mi><mo>=</mo>" in mathml("sum_(i=1)^N x")


@pytest.mark.parametrize(("source", "found"), [("a + unknown", "'unknown'"), ("(a", "parentheses"), ("a)", "parenth"),
                                               ("a & b", "'& b'"), ("a /", "nothing")])
def test_what_is_not_read_is_refused_with_the_formula(source: str, found: str) -> None:
    with pytest.raises(HarnessError) as caught:
        mathml(source)
    assert source in str(caught.value) and found in str(caught.value)
