"""The four means of an image, and the order in which arrays hold them everywhere in the harness."""

from __future__ import annotations

from enum import IntEnum


class Channel(IntEnum):
    """An index into the last axis, of length 4, of means, errors and variances."""

    RED = 0
    GREEN = 1
    BLUE = 2
    LUMINANCE = 3


# Their names, in that order.
CHANNELS = tuple(channel.name.lower() for channel in Channel)
