"""What the report says of each exhibit: formulas as GLSL, the effect in words around measured numbers, and advice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness.results import Exhibit, ExhibitImage, Finding, Plot


@dataclass(frozen=True)
class Text:
    """The words of one exhibit; `size` and `effect` have a place in braces for each measured number."""

    title: str
    file: str
    handout: str
    right: str
    size: str
    effect: str
    advice: str


TEXTS = {
    "lobe-pdf": Text(
        "The Phong lobe's pdf over π²", "course/lobe_pdf.glsl",
        "(alpha + 1) * pow(dot(r, l), alpha) / (PI * PI)",
        "(alpha + 1) * pow(dot(r, l), alpha) / (2 * PI)",
        "{lobe:+.0f} % of the lobe's light",
        "A pdf must integrate to 1; this one integrates to 2/π. Every sample of the lobe is divided by too little, "
        "and its light comes out π/2 = 1.571 times too bright, whatever the exponent. Where the pdf is cancelled on "
        "paper against the BRDF's own term it is never evaluated: with the same two formulas the strategy lobes is "
        "off by no more than {cancelled:.2f} %.",
        "Integrate every pdf that you write, on paper or by a loop over the sphere: what does not give 1 is no pdf. "
        "The constant of the lobe's pdf is then that of the lobe in the BRDF, and the two cancel."),
    "below-surface": Text(
        "Lobe samples below the surface", "course/below_surface.glsl",
        "weight = ks * dot(n, l);  // whatever l",
        "weight = dot(n, l) > 0.0 ? ks * dot(n, l) : vec3(0.0);",
        "{least:+.1f} to {most:+.1f} % of an image's light",
        "About a mirror direction near the horizon, part of the lobe lies below the surface: {share:.0f} % of the "
        "samples for a viewer at 80° and α = {alpha:g}. Kept with their negative cosine they take light away. Folded "
        "up, or drawn again until one fits, they add light that is not there, since the pdf still counts the part "
        "below. Clamped to the surface they have n·l = 0 and so the weight zero, which is right by accident.",
        "Give such a sample the weight zero, leave the pdf as it is, and count the sample among the N."),
    "tangent": Text(
        "A tangent that vanishes at (1,1,1)", "course/tangent.glsl",
        "normalize(cross(w.yzx, w))",
        "to_world of lib/sampling.glsl: Duff et al. 2017",
        "NaN in {lost:,} samples",
        "w.yzx is w turned about (1,1,1). Where w points there, the cross product is zero, normalising it gives NaN, "
        "and one NaN poisons an accumulating pixel for ever. On a sphere no pixel need ever meet that normal, so the "
        "picture of a sphere tells nothing; a flat surface that faces (1,1,1) is lost whole: {lost:,} samples. "
        "Nearby, the frame is not orthonormal.",
        "Use a frame without singularities: Duff et al. 2017, or start from the axis that w is least along. And count"
        " the samples that are not finite: a shader that drops them in silence hides this."),
    "reflect": Text(
        "The maximum of a vector", "course/reflect.glsl",
        "pow(max(reflect(l,n),0.0), alpha)",
        "pow(max(dot(reflect(-l, n), v), 0.0), alpha)",
        "no picture; repaired in haste, {error:.0f} % of the light",
        "The cosine to the viewer is missing, so a direction stands where a number must, and the compiler says so. "
        "With the dot product added and nothing else, max(dot(reflect(l,n),v),0.0), it compiles. But GLSL's reflect "
        "takes a direction that travels towards the surface; l points away from it, so the mirror direction points "
        "into the surface, and the highlights are gone ({error:.0f} % of the light). That hasty repair is what is "
        "rendered here.",
        "Go to the line that the compiler names. Then test the BRDF by itself: towards the mirror direction it must "
        "be at its brightest."),
    "sine-random": Text(
        "Random numbers from a sine", "course/random.glsl",
        "seed = (numpass*0.9610356 + 1024*texcoord.x + texcoord.y)*1.51269341231\n"
        "rand() = fract(sin(seed++)*43758.5453123)",
        "lib/random.glsl: an integer hash of (pixel, pass, replica)",
        "noise of rows {rows:.2f} correlated, late",
        "No dramatic failure: after {passes:,} passes the RMSE is {excess:+.1f} % off ours, and the image's mean "
        "{mean:+.3f} % off Mitsuba's. But the seed is a float32, with ever fewer values the larger the pass, and the "
        "sine has few to begin with. Late passes give neighbouring rows the same random numbers: at pass 20,000, "
        "which the handout's own picture gets to, their correlation is {picture:.2f}. At pass 1,000,000 the noise "
        "itself is alike ({rows:.2f} between rows, {columns:.2f} between columns): streaks that no longer average "
        "out over the picture. A GPU with another sine has other numbers than this driver.",
        "Seed an integer hash with the integer pixel, pass and replica. It is the same on every GPU, and no two "
        "pixels share a stream."),
    "sine-noise": Text(
        "Value noise on a sine", "course/noise.glsl",
        "hash(n) = fract(sin(n)*43758.5453123)",
        "lib/noise.glsl: an integer hash of the lattice point",
        "marble differs by up to {largest:.2f}",
        "The factor 43758.5 makes the last digits of the sine the first digits of the hash, and those digits are each "
        "compiler's own. Far from the origin, where lattice points have large numbers, the sine of Mitsuba's "
        "compiler and that of this GL driver differ, and one formula draws two textures: on ground 300 units from "
        "the origin, marble differs by up to {largest:.2f} of the way from black to white. Two GPUs may differ as "
        "much.",
        "Hash the lattice point with integer arithmetic: the same bits on every machine. Points that happen to share "
        "x + 57 y + 113 z then no longer share their value, either."),
    "convergence": Text(
        "Importance sampling and convergence time", "",
        "“importance sampling augments convergence time”",
        "“importance sampling reduces convergence time”",
        "without it {samples:.0f} times the samples",
        "The opposite was meant. On the course's scene, uniform sampling takes {samples:.0f} times the samples of "
        "mixture to the same RMSE (95 % interval {low:.0f} to {high:.0f}), and {time:.0f} times the CPU time.",
        "Say what is compared: samples, or time, to the same error. Both errors fall as 1/√N; importance sampling "
        "lowers the line and does not tilt it."),
}


def exhibit(id: str, findings: Sequence[Finding], images: Sequence[ExhibitImage] = (), plots: Sequence[Plot] = (),
            message: str = "", **numbers: float) -> Exhibit:
    """The exhibit of that id: its text with the measured numbers in their places, and what was found."""
    text = TEXTS[id]
    return Exhibit(id, text.title, text.file, text.handout, text.right, text.size.format(**numbers),
                   text.effect.format(**numbers), text.advice, tuple(findings), tuple(images), tuple(plots), message)
