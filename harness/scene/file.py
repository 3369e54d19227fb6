"""What is rendered: a scene file with its parameters and film size, apart from anybody's reading of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from harness.errors import HarnessError
from harness.files import data_dir


@dataclass(frozen=True)
class SceneFile:
    """A Mitsuba 3 scene file, the values of its `<default>` parameters, and the film's size if not its own.

    `parameters`: pairs of name and value, sorted by name, as Mitsuba's parser takes them (`$name` in the file).
    `size`: (width, height). Mitsuba renders any of them; our tracer reads it into a `Scene`, and may refuse.
    """

    path: Path
    parameters: tuple[tuple[str, str], ...] = ()
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", Path(self.path))
        object.__setattr__(self, "parameters", tuple(sorted(self.parameters)))

    @classmethod
    def bundled(cls, name: str, size: tuple[int, int] | None = None) -> SceneFile:
        """A scene that comes with the harness, `spheres` or `exhibits/tangent`; HarnessError for an unknown name."""
        folder = data_dir("mitsuba_scenes")
        path = folder / f"{name}.xml"
        if not path.is_file():
            known = ", ".join(sorted(file.stem for file in folder.glob("*.xml")))
            raise HarnessError(f"unknown scene '{name}'; name an .xml file, or one of {known}")
        return cls(path, size=size)

    @property
    def name(self) -> str:
        """The file's name without its suffix, with the parameters if there are any: `plates alpha=10`."""
        return " ".join([self.path.stem, *(f"{name}={value}" for name, value in self.parameters)])

    def sized(self, width: int, height: int) -> SceneFile:
        """The same with another film size."""
        return replace(self, size=(width, height))
