from __future__ import annotations

import socket

import pytest

from schemas.errors import StopError
from workers.ray_session import PACKAGES, ROOT, ray_session


def test_address_where_nobody_listens_stops_at_once() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with (
        pytest.raises(StopError, match=f"no Ray cluster answers at 127.0.0.1:{port}"),
        ray_session(cpus=1, address=f"127.0.0.1:{port}"),
    ):
        pytest.fail("there is no cluster")


def test_packages_that_travel_to_a_cluster_are_there() -> None:
    assert all((ROOT / name / "__init__.py").is_file() for name in PACKAGES)
