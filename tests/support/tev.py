"""A tev that only listens: it takes what is sent to it apart, by the protocol of tev's own src/Ipc.cpp."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

CLOSE, CREATE, UPDATE = 2, 4, 6


@dataclass
class FakeTev:
    """`packets`: (kind, name) in their order; `images`: by name, (H, W, 3), NaN where nothing was drawn."""

    address: str
    packets: list[tuple[int, str]] = field(default_factory=list)
    images: dict[str, np.ndarray] = field(default_factory=dict)
    channels: dict[str, list[str]] = field(default_factory=dict)
    history: list[np.ndarray] = field(default_factory=list)

    def take(self, packet: bytes) -> None:
        """One packet, less its length."""
        reader = _Reader(packet)
        kind = reader.number("<b")
        if kind != CLOSE:
            reader.number("<b")  # whether it comes to the front
        name = reader.text()
        self.packets.append((kind, name))
        if kind == CLOSE:
            del self.images[name]
        elif kind == CREATE:
            width, height = reader.number("<i"), reader.number("<i")
            self.channels[name] = [reader.text() for _ in range(reader.number("<i"))]
            self.images[name] = np.full((height, width, len(self.channels[name])), np.nan, np.float32)
        elif kind == UPDATE:
            self._update(name, reader)

    def _update(self, name: str, reader: _Reader) -> None:
        channels = [reader.text() for _ in range(reader.number("<i"))]
        x, y, width, height = (reader.number("<i") for _ in range(4))
        offsets = [reader.number("<q") for _ in channels]
        strides = [reader.number("<q") for _ in channels]
        data = np.frombuffer(reader.rest(), "<f4")
        for channel, offset, stride in zip(channels, offsets, strides, strict=True):
            plane = data[offset::stride][:width * height].reshape(height, width)
            self.images[name][y:y + height, x:x + width, self.channels[name].index(channel)] = plane
        self.history.append(self.images[name].copy())


class _Reader:
    def __init__(self, packet: bytes) -> None:
        self._packet, self._at = packet, 0

    def number(self, kind: str) -> int:
        value, = struct.unpack_from(kind, self._packet, self._at)
        self._at += struct.calcsize(kind)
        return int(value)

    def text(self) -> str:
        end = self._packet.index(b"\0", self._at)
        text, self._at = self._packet[self._at:end].decode(), end + 1
        return text

    def rest(self) -> bytes:
        return self._packet[self._at:]


@contextmanager
def listening() -> Iterator[FakeTev]:
    """A tev on a free port, which takes one connection after another; all has been read when the block has ended."""
    server = socket.create_server(("127.0.0.1", 0))
    fake = FakeTev(f"127.0.0.1:{server.getsockname()[1]}")
    thread = threading.Thread(target=_serve, args=(server, fake), daemon=True)
    thread.start()
    try:
        yield fake
    finally:
        with socket.create_connection(server.getsockname()) as last:  # one that says nothing ends it
            last.sendall(b"\0\0\0\0")
        thread.join()
        server.close()


def _serve(server: socket.socket, fake: FakeTev) -> None:
    while True:
        connection, _ = server.accept()
        with connection, connection.makefile("rb") as stream:
            while length := stream.read(4):
                size, = struct.unpack("<I", length)
                if size == 0:
                    return
                fake.take(stream.read(size - 4))
