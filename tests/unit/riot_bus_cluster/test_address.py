"""Only addresses of this machine go without TLS."""

from __future__ import annotations

import socket

import pytest

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_cluster.address import connect, is_open, scheduler_of


@pytest.mark.parametrize(
    ("executor", "tls", "address"),
    [
        ("dask://127.0.0.1:8786", False, "tcp://127.0.0.1:8786"),
        ("dask://localhost:1", False, "tcp://localhost:1"),
        ("dask://[::1]:8786", False, "tcp://[::1]:8786"),
        ("dask://lab-7.example:8786", True, "tls://lab-7.example:8786"),
        ("dask://127.0.0.1:8786", True, "tls://127.0.0.1:8786"),
    ],
)
def test_an_executor_is_an_address_of_dask(executor: str, tls: bool, address: str) -> None:
    assert scheduler_of(executor, tls=tls) == address


@pytest.mark.parametrize("executor", ["127.0.0.1:8786", "dask://", "dask://host", "dask://a:b@host:1", "tcp://h:1"])
def test_what_is_no_executor_is_said(executor: str) -> None:
    with pytest.raises(ConfigError, match="is not an executor"):
        scheduler_of(executor, tls=True)


@pytest.mark.parametrize("host", ["10.0.0.5", "lab-7", "[fe80::1]", "0.0.0.0"])
def test_another_machine_needs_tls(host: str) -> None:
    with pytest.raises(ConfigError, match="there is no TLS") as told:
        scheduler_of(f"dask://{host}:8786", tls=False)
    assert "DASK_DISTRIBUTED__COMM__TLS__CA_FILE" in str(told.value)
    assert is_open(f"tcp://{host}:8786")
    assert not is_open(f"tls://{host}:8786")


def test_a_scheduler_that_is_not_there_is_an_error_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus_cluster.address._CONNECTS_WITHIN_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(EnvironmentFaultError, match="no scheduler answers"):
        connect(f"dask://127.0.0.1:{port}")
