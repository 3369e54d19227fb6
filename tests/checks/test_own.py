"""The checks of somebody's library: each classic slip is named by its function, and what is right is left in peace."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from pathlib import Path

import pytest

from harness.checks import own, own_environment, own_lights, own_phong, own_random, own_sampling
from harness.checks.finding import Finding
from harness.checks.shader import probe_of
from harness.errors import HarnessError, ShaderError
from harness.files import data_dir
from harness.mutants.variants import load_variants
from harness.shader.library import OURS

VARIANTS = {variant.id: variant for variant in load_variants()}
PDF_LOBE = "return cos_to_axis > 0.0 ? (alpha + 1.0) * INV_TWO_PI * pow(cos_to_axis, alpha) : 0.0;"
PDF_COSINE = "return max(cos_theta, 0.0) * INV_PI;"
SAMPLE = "rng_state = pcg_hash(index ^ stream.x) + stream.y;"
RAND = "return float(((word >> 22u) ^ word) >> 8u) * (1.0 / 16777216.0);"
SEED = "uint a = pcg_hash(pixel.x + pcg_hash(pixel.y + pcg_hash(replica)));"
UNIFORM = "return cos_theta > 0.0 ? INV_TWO_PI : 0.0;"


def failed(findings: Iterable[Finding]) -> list[Finding]:
    return [found for found in findings if not found.passed]


@pytest.mark.parametrize(("name", "alpha", "line", "replacement", "function", "says"), [
    ("cosine", 1.0, PDF_COSINE, "return max(cos_theta, 0.0);", "pdf_cosine",
     "the pdf integrates to 3.14159, expected 1 ± 0.001, pi times too much"),
    ("uniform", 0.0, UNIFORM, "return cos_theta > 0.0 ? INV_PI : 0.0;", "pdf_uniform",
     ", expected 1 ± 0.001, 2 times too much"),
    ("uniform", 0.0, UNIFORM, "return INV_TWO_PI;", "pdf_uniform", "the pdf integrates to 2,"),
    ("lobe", 10.0, PDF_LOBE, PDF_LOBE.replace("alpha + 1.0", "alpha + 2.0"), "pdf_lobe",
     "expected 1 ± 0.001 at alpha = 10, (alpha + 2)/(alpha + 1) times too much"),
    ("lobe", 10.0, PDF_LOBE, PDF_LOBE.replace("pow(cos_to_axis, alpha)", "pow(cos_to_axis, alpha + 1.0)"), "pdf_lobe",
     "the directions are those of (alpha + 1)/(2 pi) cos^alpha, the pdf is not"),
    ("cosine", 1.0, "return direction_about(n, sqrt(1.0 - u.x), u.y);", "return direction_about(n, u.x, u.y);",
     "sample_cosine", "nor are they those of cos / pi"),
    ("cosine", 1.0, "float phi = 2.0 * PI * u;", "float phi = 6.25 * u;", "sample_cosine",
     "azimuths about their axis have a χ² of "),
    ("uniform", 0.0, "return direction_about(n, u.x, u.y);", "return 1.01 * direction_about(n, u.x, u.y);",
     "sample_uniform", "directions are off unit length by 0.01"),
])
def test_samplers_and_pdfs_are_told_apart(name: str, alpha: float, line: str, replacement: str, function: str,
                                          says: str) -> None:
    """Which of the two is wrong, and by which factor where that is one that such slips give."""
    library = OURS.with_line("lib/sampling.glsl", line, replacement)
    found = failed(own_sampling.findings(probe_of(library), [(name, alpha)]))
    assert {each.function for each in found} == {function}
    assert any(says in each.sentence for each in found), [each.sentence for each in found]


@pytest.mark.parametrize(("line", "replacement", "check"), [
    ("vec3 bitangent = vec3(b, s + axis.y * axis.y * a, -axis.y);",
     "vec3 bitangent = normalize(cross(axis.yzx, axis));", "frame"),
    ("return local.x * tangent + local.y * bitangent + local.z * axis;",
     "return local.z * tangent + local.x * bitangent + local.y * axis;", "axis"),
])
def test_a_frame_that_is_none_is_found(line: str, replacement: str, check: str) -> None:
    found = failed(own_sampling.frames_of(probe_of(OURS.with_line("lib/sampling.glsl", line, replacement))))
    assert [(each.function, each.check) for each in found] == [("to_world", check)]


@pytest.mark.parametrize(("line", "replacement", "function", "says"), [
    (SEED, "uint a = pcg_hash(pixel.x + pixel.y + pcg_hash(replica));", "pixel_stream", "pixels draw the very numbers"),
    (SEED, "uint a = pcg_hash(pixel.x + pcg_hash(pixel.y));", "pixel_stream", "65,535 of 65,536 replicas draw the"),
    (SAMPLE, "rng_state = pcg_hash((index & 255u) ^ stream.x) + stream.y;", "seed_sample",
     "65,280 of 65,536 samples of a pixel draw the very numbers of another"),
    ("rng_state = state * 747796405u + 2891336453u;", "rng_state = state;", "rand", "12.67% of the distinct values"),
    (RAND, "return float(((word >> 22u) ^ word) >> 16u) * (1.0 / 65536.0);", "rand", "of the distinct values that 24"),
    (RAND, "return 2.0 * float(((word >> 22u) ^ word) >> 8u) * (1.0 / 16777216.0);", "rand", "are outside [0, 1),"),
])
def test_a_generator_that_repeats_is_found(line: str, replacement: str, function: str, says: str) -> None:
    found = failed(own_random.findings(probe_of(OURS.with_line("lib/random.glsl", line, replacement))))
    assert found[0].function == function
    assert says in found[0].sentence, found[0].sentence


def test_a_weight_without_its_cosine_is_found_by_strategy() -> None:
    library = OURS.with_line("lib/phong.glsl",
                             "return eval_phong(m, dot(mirror, l)) * (max(cos_l, 0.0) / INV_TWO_PI);",
                             "return cos_l > 0.0 ? eval_phong(m, dot(mirror, l)) / INV_TWO_PI : vec3(0.0);")
    vertex = own_phong.VERTICES[0]
    wrong = own_phong.gathered(probe_of(library), "uniform", vertex, 0.0)
    assert not wrong.passed and wrong.function == "sample_phong"
    assert wrong.sentence.startswith("strategy 'uniform': the mean weight of red under an even sky is 1.6 ± 0, ")
    assert ", 2 times as much; kd = (0.8, 0.5, 0.2)" in wrong.sentence
    assert own_phong.gathered(probe_of(library), "mixture", vertex, 0.0).passed


def test_a_brdf_that_is_another_is_found() -> None:
    library = OURS.with_line("lib/phong.glsl", "f += m.kd * INV_PI;", "f += m.kd;")
    wrong, = failed([own_phong.values(probe_of(library), 10.0)])
    assert wrong.function == "eval_phong" and wrong.value == pytest.approx(wrong.expected * 3.14159, rel=0.3)
    assert own_phong.values(probe_of(OURS), 10.0).passed


@pytest.mark.parametrize(("line", "replacement", "function", "says"), [
    ("return textureLod(image, vec2(turns(d.x, -d.z), (row + 0.5) / rows), 0.0);",
     "return textureLod(image, vec2(turns(d.x, -d.z) + 0.04, (row + 0.5) / rows), 0.0);", "environment_texel",
     "an image is interpolated to within 0."),
    ("bool on_pole = row < 0.5;", "bool on_pole = false;", "sample_environment_texel",
     "directions against their pdf is "),
])
def test_an_environment_map_that_is_drawn_wrongly_is_found(line: str, replacement: str, function: str,
                                                           says: str) -> None:
    library = OURS.with_line("lib/environment.glsl", line, replacement)
    found = failed(own_environment.findings(probe_of(library)))
    assert found[0].function == function
    assert says in found[0].sentence, found[0].sentence


@pytest.mark.parametrize(("line", "replacement", "check", "function", "says"), [
    ("float pdf = height > 0.0 ? squared * distance / (area * height) : 0.0;",
     "float pdf = height > 0.0 ? squared / area : 0.0;", "measure", "sample_rectangle",
     "steradians where it takes 0.9931; of its 128 parts one has "),
    ("float pdf = height > 0.0 ? squared * distance / (area * height) : 0.0;",
     "float pdf = squared * distance / (area * abs(height));", "dark", "sample_rectangle",
     "from where nothing of a rectangle shines, 100.00% of the directions have a density above zero"),
    ("return INV_TWO_PI / ball_cap(o, center, squared_radius);",
     "return 0.5 * INV_TWO_PI / ball_cap(o, center, squared_radius);", "agreement", "pdf_ball",
     "of rays that met a ball the density is within 0.5 of that with which they were drawn"),
    ("bool on_y = !on_x && at < seen.x + seen.y;", "bool on_y = !on_x && at < seen.y;", "measure", "sample_cube", ""),
    ("float phi = (2.0 * u.x - 1.0) * arc;", "float phi = u.x * arc;", "measure", "sample_cylinder", "is never drawn"),
    ("return LightSample(way / distance, pdf, NEARLY * distance);", "return LightSample(way, pdf, NEARLY * distance);",
     "length", "sample_rectangle", "directions to a rectangle are off unit length by "),
])
def test_a_light_that_is_drawn_wrongly_is_found(line: str, replacement: str, check: str, function: str,
                                                says: str) -> None:
    found = failed(own_lights.findings(probe_of(OURS.with_line("lib/lights.glsl", line, replacement))))
    assert (found[0].check, found[0].function) == (check, function)
    assert says in found[0].sentence, found[0].sentence


@pytest.mark.parametrize(("variant", "topic"), [
    ("ball-in-a-wider-cone", "light sampling"), ("cube-with-hidden-faces", "light sampling"),
    ("rectangle-from-another-corner", "light sampling"), ("", "light sampling"),
    ("kronecker", "random numbers"), ("shared-sequence", "random numbers"), ("other-hash", "random numbers"),
    ("cross-product-basis", "frames"), ("", "frames"), ("", "the environment map")])
def test_what_is_right_is_left_in_peace(variant: str, topic: str) -> None:
    """Generators whose samples follow a sequence, another hash, another basis, lights drawn otherwise, ours."""
    found = own.checked(VARIANTS[variant].applied() if variant else OURS, [topic])
    assert not found.failed and not found.unchecked and found.findings


def test_weights_of_a_shared_sequence_are_right() -> None:
    """Its pixels are not independent, so that a mean over them is not that of its samples."""
    probe = probe_of(VARIANTS["shared-sequence"].applied())
    assert own_phong.gathered(probe, "uniform", own_phong.VERTICES[0], 0.0).passed


def test_another_distribution_with_its_own_pdf_is_no_error() -> None:
    """cos^2 in place of cos: right in an estimator, whatever the functions are called."""
    library = OURS.with_line("lib/sampling.glsl", "return direction_about(n, sqrt(1.0 - u.x), u.y);",
                             "return direction_about(n, pow(1.0 - u.x, 1.0 / 3.0), u.y);")
    library = library.with_line("lib/sampling.glsl", PDF_COSINE,
                                "return 3.0 * INV_TWO_PI * max(cos_theta, 0.0) * max(cos_theta, 0.0);")
    assert not failed(own_sampling.findings(probe_of(library), [("cosine", 1.0)]))


class TestFolder:
    """Somebody's files."""

    def test_a_function_is_named_with_its_file_and_line(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(own, "TOPICS", {"frames": own.TOPICS["frames"]})
        text = (data_dir("glsl") / "lib" / "sampling.glsl").read_text(encoding="utf-8")
        place = next(number for number, line in enumerate(text.splitlines(), 1) if line.startswith("vec3 to_world"))
        wrong = text.replace("1.0 + s * axis.x * axis.x * a", "1.0 + axis.x * axis.x * a")
        self.write(tmp_path, "sampling.glsl", wrong)
        told: list[float] = []
        found = own.check_library(tmp_path, told.append)
        assert [each.where for each in found.failed] == [f"{tmp_path / 'lib' / 'sampling.glsl'}:{place}"]
        assert "axes have no orthonormal frame" in found.failed[0].sentence
        assert told == [1]

    def test_functions_of_other_parameters_are_said_not_to_be_checked(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setattr(own, "TOPICS", {"frames": own.TOPICS["frames"]})
        self.write(tmp_path, "sampling.glsl", "mat3 basis(vec3 n)\n{\n    return mat3(1.0);\n}\n")
        found = own.check_library(tmp_path)
        assert found.findings == () and not found.failed
        assert found.unchecked[0].startswith("frames: its functions do not fit (probes/basis.frag:")

    def test_what_does_not_compile_is_an_error_of_its_own_line(self, tmp_path: Path) -> None:
        self.write(tmp_path, "random.glsl", "float rand()\n{\n    return nothing;\n}\n")
        with pytest.raises(ShaderError, match=r"random\.glsl:3: .*nothing"):
            own.check_library(tmp_path)

    def test_a_folder_with_nothing_to_check_is_refused(self, tmp_path: Path) -> None:
        self.write(tmp_path, "camera.glsl", "// mine\n")
        with pytest.raises(HarnessError, match=r"holds none of the files whose functions are checked: "
                                               r"lib/environment\.glsl, lib/lights\.glsl, lib/phong\.glsl, "
                                               r"lib/random\.glsl, lib/sampling\.glsl, lib/trigonometry\.glsl, "
                                               r"lib/uv\.glsl"):
            own.check_library(tmp_path)
        with pytest.raises(HarnessError, match="is not a folder"):
            own.check_library(tmp_path / "lib" / "camera.glsl")

    @staticmethod
    def write(folder: Path, name: str, text: str) -> None:
        (folder / "lib").mkdir()
        (folder / "lib" / name).write_text(text, encoding="utf-8")


def test_what_all_that_failed_have_in_common_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a circle, in the function by which both samplers place their directions."""
    two = functools.partial(own_sampling.findings, cases=[("uniform", 0.0), ("cosine", 1.0)])
    monkeypatch.setattr(own, "TOPICS", {"sampling": ("sampling.frag", two)})
    library = OURS.with_line("lib/sampling.glsl", "float phi = 2.0 * PI * u;", "float phi = PI * u;")
    found = own.checked(library, ["sampling"])
    assert {each.function for each in found.failed} == {"sample_uniform", "sample_cosine"}
    assert found.shared == ("direction_about",)


def test_a_check_is_said_once_by_function() -> None:
    """Of several exponents the first; all stand in the findings."""
    found = own.Proofs((Finding("integral", 2, 1, False, "a", function="f"), Finding("integral", 3, 1, False, "b",
                         function="f"), Finding("chi2", 2, 1, False, "c", function="f")), ())
    assert [each.sentence for each in found.failed] == ["a", "c"] and found.functions == ("f",)
