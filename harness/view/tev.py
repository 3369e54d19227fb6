"""Sends images to tev, the HDR image viewer, over its socket (`tevclient` speaks the protocol of its ipc.h)."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from typing import Any

import numpy as np

from harness.errors import HarnessError, MachineError

# What installs the extra `live`, in whichever environment this is.
INSTALL = f"{sys.executable} -m pip install 'tevclient>=1'"
# Where tev listens unless its own option --host says otherwise.
ADDRESS = "localhost:14158"
CHANNELS = ["R", "G", "B"]


class Tev:
    """A running tev. An image is made there the first time that it is shown, and its pixels replaced afterwards.

    To be used in a `with`. HarnessError for an address that is none, MachineError where the package is missing or no
    tev listens there.
    """

    def __init__(self, address: str = ADDRESS) -> None:
        host, _, port = address.rpartition(":")
        if not host or not re.fullmatch(r"[0-9]{1,5}", port) or not 0 < int(port) < 1 << 16:
            raise HarnessError(f"--tev-at: expected HOST:PORT, such as {ADDRESS}; found '{address}'")
        self._host, self._port = host, int(port)
        self._client: Any = None
        self._sizes: dict[str, tuple[int, ...]] = {}

    def __enter__(self) -> Tev:
        try:
            self._connect()
        except HarnessError as error:
            raise MachineError(str(error)) from None
        return self

    def __exit__(self, *raised: object) -> None:
        self._close()

    def show(self, name: str, image: np.ndarray) -> None:
        """Show radiance (H, W, 3) under a name. HarnessError where tev went away; the next call looks for one again."""
        if self._client is None:
            self._connect()
        height, width = image.shape[:2]
        try:
            if self._sizes.get(name) != image.shape:
                if name in self._sizes:
                    self._client.close_image(name)
                self._client.create_image(name, width, height, CHANNELS, grab_focus=True)
                self._sizes[name] = image.shape
            self._client.update_image(name, image.astype(np.float32), CHANNELS, grab_focus=False)
        except OSError as error:
            self._close()
            raise HarnessError(f"tev at {self._host}:{self._port} went away ({error.strerror or error}); start it "
                               "again") from None

    def _connect(self) -> None:
        try:
            import tevclient
        except ImportError:
            raise MachineError(f"--tev needs the package tevclient; type: {INSTALL}") from None
        client = tevclient.Ipc(self._host, self._port)
        try:
            client.__enter__()
        except OSError as error:
            raise HarnessError(f"no tev answers at {self._host}:{self._port} ({error.strerror or error}); start tev "
                               "first, or say with --tev-at HOST:PORT where it listens") from None
        self._client, self._sizes = client, {}

    def _close(self) -> None:
        if self._client is not None:
            with suppress(OSError):
                self._client.__exit__(None, None, None)
            self._client = None
