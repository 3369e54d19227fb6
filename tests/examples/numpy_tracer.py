"""A path tracer of fifty lines, as anybody might have one: `python numpy_tracer.py OUT.pfm SEED SPP WIDTH HEIGHT`.

It renders ball.xml, whose numbers stand here once more, and knows nothing of the harness, which judges it:

    harness compare --command "python numpy_tracer.py {out} {seed} {spp} {width} {height}" --scene ball.xml
"""

import sys

import numpy as np

SKY, ALBEDO = np.array([0.6, 0.8, 1.0]), np.array([[0.8, 0.4, 0.2], [0.5, 0.5, 0.5]])  # ball, floor
EYE, TAN, SCATTERINGS, EPSILON = np.array([0.0, 1.0, 6.0]), np.tan(np.radians(20)), 3, 1e-4


def hit(o, d):
    """What the rays meet first: 0 the ball, 1 the floor, -1 nothing; how far away; the normal there."""
    b = ((o - [0, 1, 0]) * d).sum(1)
    root = b * b - ((o - [0, 1, 0]) ** 2).sum(1) + 1
    ball = -b - np.sqrt(np.maximum(root, 0))
    ball = np.where((root > 0) & (ball > EPSILON), ball, np.inf)
    floor = np.divide(-o[:, 1], d[:, 1], out=np.full(len(d), np.inf), where=np.abs(d[:, 1]) > 1e-9)
    floor = np.where((floor > EPSILON) & (np.abs(o + np.minimum(floor, 1e9)[:, None] * d)[:, [0, 2]].max(1) < 100),
                     floor, np.inf)
    t = np.minimum(ball, floor)
    which = np.where(np.isinf(t), -1, np.where(ball < floor, 0, 1))
    at = o + np.where(which < 0, 0, t)[:, None] * d
    return which, at, np.where((which == 0)[:, None], at - [0, 1, 0], [0.0, 1.0, 0.0])


def cosine(n, rng):
    """A direction about each normal, with a density proportional to the cosine: to a point of the unit sphere around
    the normal's tip."""
    v = rng.standard_normal(n.shape)
    w = n + v / np.linalg.norm(v, axis=1, keepdims=True)
    return w / np.linalg.norm(w, axis=1, keepdims=True)


def trace(width, height, rng):
    """One sample a pixel, (height, width, 3); row 0 is on top."""
    y, x = np.mgrid[:height, :width].reshape(2, -1) + rng.random((2, width * height))
    d = np.stack([(2 * x / width - 1) * TAN, (1 - 2 * y / height) * TAN * height / width, -np.ones_like(x)], 1)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o, mask, light = np.tile(EYE, (len(d), 1)), np.ones((len(d), 3)), np.zeros((len(d), 3))
    for _ in range(SCATTERINGS + 1):
        which, at, n = hit(o, d)
        light += np.where((which < 0)[:, None], mask * SKY, 0)
        mask = np.where((which < 0)[:, None], 0, mask * ALBEDO[which])  # f cos / pdf is the albedo
        o, d = at, cosine(n, rng)
    return light.reshape(height, width, 3)


if __name__ == "__main__":
    out, (seed, spp, width, height) = sys.argv[1], map(int, sys.argv[2:6])
    rng = np.random.default_rng(seed)
    image = sum(trace(width, height, rng) for _ in range(spp)) / spp
    with open(out, "wb") as file:
        file.write(b"PF\n%d %d\n-1.0\n" % (width, height) + image[::-1].astype("<f4").tobytes())
