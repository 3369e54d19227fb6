"""The loop of `harness view`: keys, a batch, the picture, and again."""

from __future__ import annotations

import time
from typing import Protocol

import numpy as np

from harness.view.session import Session

# Seconds between two looks at the keyboard where nothing is drawn.
REST = 0.03


class Screen(Protocol):
    """What `harness.gpu.window.Window` is to the loop."""

    @property
    def closed(self) -> bool:
        """Whether the user closed it."""

    def name(self, title: str) -> None:
        """Set the title."""

    def keys(self) -> list[str]:
        """The keys pressed since it was asked last."""

    def show(self, image: np.ndarray, exposure: float = 0.0) -> None:
        """Show an image, and take up what the user did."""


def watch(session: Session, screen: Screen) -> None:
    """Draw until the user leaves. HarnessError as the estimator says."""
    while not screen.closed:
        for key in screen.keys():
            session.press(key)
        if session.done:
            return
        session.advance()
        screen.name(session.title)
        screen.show(session.image, session.chosen.exposure)
        if session.paused:
            time.sleep(REST)
