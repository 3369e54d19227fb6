"""What is sent to tev is the image, by its protocol; where no tev is, one line says so."""

from __future__ import annotations

import socket
import sys

import numpy as np
import pytest

from harness.errors import HarnessError, MachineError
from harness.view.tev import Tev
from tests.support.tev import CLOSE, CREATE, UPDATE, listening

IMAGE = np.random.default_rng(1).random((150, 140, 3))  # more than one of the client's tiles


def test_an_image_is_made_once_and_then_updated() -> None:
    with listening() as fake, Tev(fake.address) as tev:
        tev.show("spheres mixture", IMAGE)
        tev.show("spheres mixture", 2 * IMAGE)
        tev.show("spheres mixture", IMAGE[:10, :20])
    assert [kind for kind, _ in fake.packets] == [CREATE, *[UPDATE] * 8, CLOSE, CREATE, UPDATE]
    assert {name for _, name in fake.packets} == {"spheres mixture"}
    assert fake.channels["spheres mixture"] == ["R", "G", "B"]
    np.testing.assert_array_equal(fake.history[7], (2 * IMAGE).astype(np.float32))
    np.testing.assert_array_equal(fake.images["spheres mixture"], IMAGE[:10, :20].astype(np.float32))


def test_without_a_tev_the_error_says_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(MachineError, match=rf"^no tev answers at {address} \(Connection refused\); start tev first, or "
                       "say with --tev-at HOST:PORT where it listens$"), Tev(address):
        pass


@pytest.mark.parametrize("address", ["14158", "localhost:", ":1", "localhost:0", "localhost:70000", "a b:c"])
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(HarnessError, match="--tev-at: expected HOST:PORT, such as localhost:14158"):
        Tev(address)


def test_a_tev_that_went_away_is_looked_for_again() -> None:
    with listening() as fake, Tev(fake.address) as tev:
        tev.show("a", IMAGE)
        tev._client._socket.shutdown(socket.SHUT_RDWR)
        with pytest.raises(HarnessError, match=rf"^tev at {fake.address} went away .*; start it again$"):
            tev.show("a", IMAGE)
        tev.show("a", IMAGE)
    np.testing.assert_array_equal(fake.images["a"], IMAGE.astype(np.float32))
    assert fake.packets.count((CREATE, "a")) == 2, "another tev knows nothing of the image"


def test_the_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tevclient", None)
    with pytest.raises(MachineError, match=r"--tev needs the package tevclient; type: .* -m pip install"), Tev():
        pass
