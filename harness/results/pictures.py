"""A long render as it is kept: one row of what it took."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KeptPicture:
    """A picture of `scene`, rendered once at `width` x `height` pixels with `spp` samples each, of which `rejected`
    over the whole image were not finite; the handout's has `asked`. `seconds` by the clock that counts on `device`;
    `date`: when it was kept."""

    scene: str
    strategy: str
    width: int
    height: int
    spp: int
    asked: int
    rejected: int
    seconds: float
    device: str
    date: str

    @property
    def file(self) -> str:
        """The name of its JPEG, beside the record."""
        return f"{self.scene}.jpg"
