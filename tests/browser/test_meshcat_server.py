"""Reachability of the Meshcat server; no browser is needed for it."""

import socket

import psutil
import pytest

import arm_drake as ad


def test_the_server_listens_to_this_machine_only() -> None:
    meshcat = ad.start_meshcat()

    listening = {
        connection.laddr.ip
        for connection in psutil.Process().net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
        and connection.laddr.port == meshcat.port()
    }

    assert listening
    assert listening <= {"127.0.0.1", "::1"}


def test_the_server_refuses_connections_from_elsewhere() -> None:
    meshcat = ad.start_meshcat()
    addresses = [
        address.address
        for interface in psutil.net_if_addrs().values()
        for address in interface
        if address.family == socket.AF_INET and address.address != "127.0.0.1"
    ]

    # 127.0.0.2 is this machine too, but not where the server listens.
    for address in ["127.0.0.2", *addresses]:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((address, meshcat.port()), timeout=5.0).close()


def test_port_0_is_any_free_one() -> None:
    meshcat = ad.start_meshcat(port=0)

    assert meshcat.port() != 0
    assert meshcat.web_url() == f"http://localhost:{meshcat.port()}"
