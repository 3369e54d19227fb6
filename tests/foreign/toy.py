"""Runs a Shadertoy JSON in wgpu-shadertoy, in a Python that has it: toy.py FILE.json WIDTH HEIGHT FRAMES OUT.npy."""

import sys

import numpy as np
from wgpu_shadertoy import Shadertoy

path, width, height, frames, out = sys.argv[1], *map(int, sys.argv[2:5]), sys.argv[5]
toy = Shadertoy.from_json(path, resolution=(width, height), offscreen=True)
for number in range(frames):
    toy.snapshot(time_float=number / 60, frame=number)
pitch = (16 * width + 255) // 256 * 256  # rows of a copied texture begin at multiples of 256 bytes
data = toy._device.queue.read_texture(
    {"texture": toy.buffers["a"].texture_front, "mip_level": 0, "origin": (0, 0, 0)},
    {"offset": 0, "bytes_per_row": pitch, "rows_per_image": height}, (width, height, 1))
np.save(out, np.frombuffer(data, np.float32).reshape(height, pitch // 4)[::-1, :4 * width].reshape(height, width, 4))
