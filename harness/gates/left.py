"""Names of the files that a gate leaves behind."""

from __future__ import annotations

RESULT_FILE, AUTOPSY = "result.json", "autopsy.txt"
IMAGES = ("test.exr", "test.png", "reference.exr", "reference.png")
Z_MAP, DIFFERENCE, CURVE = "z-map.png", "difference.png", "curve.svg"
# Of the ladder of depths, where there is one: errors by depth, and the difference at the first that is wrong.
LADDER, WRONG_DEPTH = "ladder.svg", "difference-at-wrong-depth.png"
PICTURES = ("test.png", "reference.png", DIFFERENCE, Z_MAP, CURVE)
ALL_PICTURES = (*PICTURES, LADDER, WRONG_DEPTH)
