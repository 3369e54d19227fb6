"""Repairs: a known slip's line, mended, and nothing else of the text."""

from __future__ import annotations

import re

import pytest

from harness.diagnosis.causes.catalogue import load_defects
from harness.diagnosis.causes.repairs import _slips, repairs


@pytest.mark.parametrize(("cause", "line", "after"), [
    ("cosine-twice", "mask *= albedo * dot(refDir, normal);", "mask *= albedo;"),
    ("cosine-twice", "thr *= kd * max(0.0, dot(n, wi)); // weight", "thr *= kd; // weight"),
    ("cosine-twice", "thr *= max(dot(n, wi), 0.0) * kd;", None),
    ("half-weight", "throughput *= albedo * cosTheta;", "throughput *= 2.0 * (albedo * cosTheta);"),
    ("cosine-missing", "vec3 normal = hit.n; vec3 newDir; mask *= albedo;",
     "vec3 normal = hit.n; vec3 newDir; mask *= 2.0 * max(dot(normal, newDir), 0.0) * (albedo);"),
    ("in-sphere-for-on-sphere", "vec3 d = normalize(n + randomInUnitSphere(seed));",
     "vec3 d = normalize(n + normalize(randomInUnitSphere(seed)));"),
    ("scattered-not-normalised", "rd = n + onSphere(s);", "rd = normalize(n + onSphere(s));"),
    ("scattered-not-normalised", "rd = normalize(n + onSphere(s));", None),
    ("sphere-normal-not-unit", "n = p - s.center;", "n = normalize(p - s.center);"),
    ("albedo-squared", "col *= m.albedo * m.albedo;", "col *= m.albedo;"),
    ("specular-plus-two", "float f = (m.alpha + 2.0) / 6.28;", "float f = (m.alpha + 1.0) / 6.28;"),
    ("lobe-drawn-without-plus-one", "float c = pow(u, 1.0 / alpha);", "float c = pow(u, 1.0 / (alpha + 1.0));"),
    ("samples-clamped", "col = clamp(col, 0.0, 1.0);", "col = col;"),
    ("gamma-before-average", "col = pow(col, vec3(1.0 / 2.2));", "col = col;"),
    ("half-pixel-up-right", "vec2 uv = (fragCoord + vec2(rand(), rand())) / iResolution.xy;",
     "vec2 uv = (fragCoord - 0.5 + vec2(rand(), rand())) / iResolution.xy;"),
    ("one-bounce-less", "for (int i = 1; i < 5; i++) {", "for (int i = 0; i < 5; i++) {"),
    ("last-weight-only", "throughput = brdf * c / pdf;", "throughput *= brdf * c / pdf;"),
])
def test_mends_the_line(cause: str, line: str, after: str | None) -> None:
    text = f"// {line}\nfloat before;\n{line}\nfloat after;"
    found = repairs(cause, text)
    if after is None:
        assert line not in {repair.before for repair in found} or found == ()
        return
    assert after in {repair.after for repair in found}
    repair = next(repair for repair in found if repair.after == after)
    assert repair.line == 3
    assert repair.text.split("\n") == [f"// {line}", "float before;", after, "float after;"]


def test_knows_causes_of_the_catalogue_only() -> None:
    assert {cause for slip in _slips() for cause in slip.causes} <= {defect.id for defect in load_defects()}


def test_proposes_nothing_for_what_it_does_not_know() -> None:
    assert repairs("one-bounce-less", "void main() {}") == ()
    assert repairs("no-such-cause", "mask *= albedo * dot(refDir, normal);") == ()


def test_every_slip_says_what_it_does() -> None:
    assert all(slip.says and not re.search(r"[.;]$", slip.says) for slip in _slips())
