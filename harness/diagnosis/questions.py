"""The questions of an autopsy: the stages of a path in the order in which it comes to them.

To ask another, give it a row here, at its place in the path; ask it in `paths.py` or `vertices.py`, by `Tally.ask`;
and if its functions depend on what differs, say so in `place.py`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Question:
    """A stage of a path.

    `tolerance`: the largest difference that is rounding, in the units that `measure` names, and `reason` why it is that
    much. `functions` compute the stage, the likeliest first; `line` is what tells its line in the first of them, where
    that has many.
    """

    name: str
    asks: str
    measure: str
    tolerance: float
    reason: str
    functions: tuple[str, ...]
    line: str = ""


_EXACT = "integers, or copies of what the shader itself computed: no rounding"
_LOOP = ("trace_samples",)
_START = ("start_path", *_LOOP)

QUESTIONS = {question.name: question for question in (
    Question("pass", "which samples main asks for, and what becomes of their sum", "any difference", 0.0, _EXACT,
             ("main",)),
    Question("stream", "the pixel's stream of numbers", "different bits", 0.0, _EXACT, ("pixel_stream", "pcg_hash")),
    Question("index", "the sample's index", "different bits", 0.0, _EXACT, _START, "seed_sample("),
    Question("seed", "the generator's state after seeding", "different bits", 0.0, _EXACT,
             ("seed_sample", "pcg_hash")),
    Question("numbers", "random numbers and the generator's states", "any difference", 0.0, _EXACT, ("rand",)),
    Question("film", "the point of the film, and the numbers of the lens", "of the film's side", 1e-6,
             "(pixel + number) / size in float32", _START, "_ray("),
    Question("time", "the number that makes the path's time", "of the shutter's interval", 0.0, _EXACT, _LOOP,
             "set_time("),
    Question("moment", "the time that set_time makes of it", "of the interval's ends", 1e-6, "one float32 product",
             ("set_time",)),
    Question("pose", "where moving shapes are at that time", "of the point's coordinates", 1e-5,
             "a rotation's float32 sines and products", ("screw_pose", "to_rest", "from_rest")),
    Question("camera", "the camera's ray", "of unit vectors, and of 1 + |origin|", 2e-5,
             "two float32 normalisations, one on each side", ("camera_ray",)),
    Question("arguments", "what the loop hands to the library", "of what it was told", 1e-4,
             "p = o + t d once more, in float32", _LOOP, "sample_bsdf("),
    Question("hit", "the shape that is met", "another shape", 0.0, "silhouettes: a few rays in a million",
             ("intersect_scene",)),
    Question("distance", "the distance to it, across the surface", "of 1 + |origin| + distance", 1e-5,
             "float32 quadratics and products on both sides; 50 times that on cylinders, which are Mitsuba's coarse "
             "ones; meshes for displaced spheres", ("intersect_scene",)),
    Question("branch", "whether a hit is shaded and an escape gathers the environment", "yes or no", 0.0, _EXACT, _LOOP,
             "if (id < 0)"),
    Question("normal", "the normal", "of a unit vector", 5e-5, "float32 on both sides; 50 times that on cylinders",
             ("surface_normal",)),
    Question("place", "the point that is met, off the surface", "of 1 + its coordinates", 1e-5,
             "o + t d in float32, or projected onto the shape", ("project_hit", "trace_samples")),
    Question("coordinate", "the texture coordinates", "of the unit square", 5e-5,
             "float32 arc tangents of points that are 1e-6 apart", ("surface_uv",)),
    Question("gathers", "whether emission is asked for", "yes or no", 0.0, "grazing rays are left out", _LOOP,
             "emission("),
    Question("light", "the light gathered", "relative", 2e-3, "texels between which float32 coordinates interpolate",
             ("emission",)),
    Question("scatters", "whether the path scatters", "yes or no", 0.0, "grazing rays are left out", _LOOP,
             "vertex < MAX_DEPTH"),
    Question("draws", "how many numbers were taken, and from which state", "different bits", 0.0, _EXACT, _LOOP,
             "sample_bsdf("),
    Question("material", "the material", "of albedos, and relative", 2e-3,
             "texels between which float32 coordinates interpolate", ("material",)),
    Question("lobe", "the term, the axis and the exponent that a direction is drawn by", "of a unit vector, relative",
             1e-4, "the mirror direction in float32", ("sample_phong",), "sample_lobe("),
    Question("frame", "the basis about the axis", "of unit vectors", 2e-4,
             "float32, where the construction divides by 0.6 at least", ("to_world",)),
    Question("azimuth", "the direction at an azimuth about the axis", "of a unit vector", 5e-5, "float32 sines",
             ("direction_about",)),
    Question("direction", "the direction drawn", "of a unit vector", 3e-4,
             "a root of 1 - u and of 1 - cos² in float32", ("sample_lobe",)),
    Question("pdf", "the densities of the direction", "relative, of 0.01 + density", 3e-3,
             "drivers' pow: 1.3e-4 at an exponent of 1000", ("pdf_lobe",)),
    Question("brdf", "the BRDF's value", "relative, of 0.01 + value", 3e-3, "drivers' pow", ("eval_phong",)),
    Question("weight", "the weight f cos / pdf", "relative, of 0.01 + weight", 3e-3, "drivers' pow", ("sample_phong",),
             "return"),
    Question("offset", "how far the next origin is lifted off the surface", "of the least and the most", 0.0,
             "bounds, not values: see harness/diagnosis/vertices.py", ("offset_origin",)),
    Question("origin", "whether the next ray starts there, and goes where it was sent", "of 1 + |origin|", 2e-6,
             "a copy of what the shader computed, but for the place, o + t d once more", _LOOP, "offset_origin("),
    Question("goes on", "whether the path goes on", "yes or no", 0.0, _EXACT, _LOOP, "alive ="),
    Question("counted", "how many samples were counted", "any difference", 0.0, _EXACT, _LOOP, "++finished"),
    Question("radiance", "the sum: light times weights, and what was there before", "relative, of 0.01 + sum", 1e-4,
             "float32 sums in another order", _LOOP, "sum +="),
    Question("finite", "what counts as a number", "yes or no", 0.0, _EXACT, ("is_finite",)),
    Question("display", "the picture shown", "of 255", 1.5, "8 bits, and drivers' pow", ("main", "encode_srgb")),
    # Of vertices' rays to lights: harness/diagnosis/lights.py. Names of a dozen letters fit the table.
    Question("chosen", "the light that a number chooses, and its chance", "another light, and of its chance", 1e-5,
             "sums of chances in float32", ("choose_light",)),
    Question("aimed", "the direction drawn towards it", "of a unit vector", 1e-3,
             "float32 roots of 1 - cos, and points that are near", ("sample_light",)),
    Question("light pdf", "the density of that direction", "relative, of 0.01 + density", 3e-3,
             "heights above a light's plane cancel in float32", ("sample_light",)),
    Question("least", "from which distance on the light is what was drawn", "of the distance", 5e-5,
             "one float32 product", ("sample_light",)),
    Question("reflected", "what of a light the surface reflects, without the cosine", "relative, of 0.01 + value",
             3e-3, "drivers' pow", ("eval_bsdf", "eval_phong")),
    Question("bsdf pdf", "how densely the surface's own draw has that direction", "relative, of 0.01 + density",
             3e-3, "drivers' pow", ("pdf_bsdf", "pdf_phong")),
    Question("drawn pdf", "how densely it drew its own direction", "relative, of 0.01 + density", 3e-3,
             "drivers' pow", ("sample_bsdf",)),
    Question("heuristic", "what a sample weighs beside the other technique", "of 1", 1e-4, "float32 quotients",
             ("mis_weight",)),
    Question("sent", "the radiance that the light sends back", "relative", 2e-3,
             "texels between which float32 coordinates interpolate", ("light_radiance", "emission")),
    Question("met pdf", "how densely lights are sampled where a ray met one", "relative, of 0.01 + density", 3e-3,
             "as of the direction that was drawn", ("met_light_pdf",)),
    Question("light weight", "what a light's radiance is multiplied by: answer times cosine over density",
             "relative, of 0.01 + weight", 3e-4, "float32 products in another order", ("aim_at_light",), "weight ="),
    Question("shadow", "whether the light counts, by what its ray meets and how far off",
             "relative, of 0.01 + radiance", 1e-5, "what the shader itself computed", ("light_reached",), "ray.light"),
    Question("lit paths", "where paths gather sampled light, and what of the light that they meet",
             "relative, of a sample's radiance and a hundredth of the mean", 2e-3,
             "float32 sums along a path; a few that part", _LOOP, "light_reached("),
    Question("weighed", "the weights of light that is met beside light that is sampled",
             "relative, of a sample's radiance and a hundredth of the mean", 2e-3,
             "float32 sums along a path; a few that part", _LOOP, "OF_MET_LIGHT("),
)}
ORDER = {name: number for number, name in enumerate(QUESTIONS)}
