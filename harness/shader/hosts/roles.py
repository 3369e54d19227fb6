"""What a uniform is for, told by its name and type, where its host has no word of its own for it."""

from __future__ import annotations

import re

from harness.shader.contract import Channel, Role

_NUMBER = frozenset({"int", "uint", "float"})
_VECTOR = re.compile(r"[iu]?vec[234]$")
# A name in snake case, without the prefixes that engines give: u_frameCount and uFrameCount are frame_count.
_PREFIX = re.compile(r"^(?:u|i|g|m|p|uniform)_+")

# The first row that fits a name (in snake case) and a type holds. The past's and the new frame's weight are told apart
# by experiment: here a weight is the past's unless its name says that it is the new frame's.
_ROLES: tuple[tuple[Role, str, str], ...] = (
    ("new_weight", r"(?:new|sample|current)_?(?:weight|factor|blend)$", "float"),
    ("past_weight", r"weight|(?:^|_)(?:blend|mix)(?:_|$)|blending|(?:past|old|accum\w*|history|texture)_(?:alpha|"
                    r"factor)$", "float"),
    ("random", r"rand|seed|(?:^|_)rng|noise|jitter|entropy", "float|int|uint|[iu]?vec[234]"),
    ("count", r"^(?:frames_total|total_frames|max_frames|num_frames)$", "float|int|uint"),
    ("frame", r"^(?:accum\w*_)?(?:frame|frames|pass|passes|iter|iteration|iterations|sample|samples|tick|ticks|epoch|"
              r"step|numpass|counter|count)(?:_(?:count|counter|number|num|no|id|index|idx|n|nr))?$|^(?:current|rendered|"
              r"accumulated|num|number_of|total|run|spp)_(?:frame|frames|sample|samples|iteration|iterations|pass|passes|"
              r"counter)(?:_(?:count|number|index))?$|^(?:frame|sample|pass|iteration)s?_?(?:since|so_far|rendered|"
              r"accumulated)\w*$", "float|int|uint"),
    ("time_delta", r"^(?:delta_?time|time_?delta|dt|frame_?time)$", "float"),
    ("date", r"^date$", "vec4"),
    ("time", r"time|seconds|elapsed|(?:^|_)clock", "float"),
    ("resolution", r"resolution$|(?:^|_)res$|^(?:view_?port|view|screen|window|canvas|image|buffer|frame_?buffer|"
                   r"render|display|texture|tex|target)_?(?:size|dim\w*|res\w*|resolution)?$|^(?:size|dimensions?|dims?)$",
     "[iu]?vec[234]"),
    ("width", r"(?:^|_)width$", "float|int|uint"),
    ("height", r"^(?:(?:view_?port|screen|window|canvas|image|buffer|render|display)_)?height$", "float|int|uint"),
    ("aspect", r"^(?:\w+_)?aspect(?:_ratio)?$", "float"),
    ("mouse", r"mouse|cursor", "float|int|[iu]?vec[234]|bool"),
)
_PAST = re.compile(r"prev|last|accum|back_?buffer|ping|pong|feed_?back|hist|(?:^|_)(?:past|old|self|fb|fbo)(?:_|$)|"
                   r"^(?:frame|image|tex|texture|source|partial|buffer|sampler|rendered|screen|color|colou?r_texture|"
                   r"result|scene_texture|diffuse|t_diffuse)(?:_?(?:tex|texture|buffer|image|sampler|[01]))?$")
_NOISE = re.compile(r"noise|rand|rng|seed|dither")
_STAND_INS = {"samplerCube": "cube", "sampler3D": "volume"}


def snake(name: str) -> str:
    """A name's words: u_frameCount, uFrameCount and FRAME_COUNT are frame_count."""
    name = name.rsplit(".", 1)[-1].strip("_")
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
    return _PREFIX.sub("", words)


def role_of(kind: str, name: str) -> Role | None:
    """What a uniform is for; None where its name does not tell."""
    words = snake(name)
    for role, pattern, kinds in _ROLES:
        if re.fullmatch(kinds, kind) and re.search(pattern, words):
            return role
    return None


def channel_of(kind: str, name: str) -> Channel | None:
    """What a sampler reads: its pass's past, or a stand-in; None where its name does not tell."""
    words = snake(name)
    if kind in _STAND_INS:
        return Channel(name, _STAND_INS[kind], kind)
    if kind != "sampler2D":
        return None
    if _NOISE.search(words):
        return Channel(name, "noise", repeat=True)
    return Channel(name, "self") if _PAST.search(words) else None
