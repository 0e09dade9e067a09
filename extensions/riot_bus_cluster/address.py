"""The address of a cluster, and the connection to it: TLS is required beyond this machine."""

from __future__ import annotations

import ipaddress
import logging
import re
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, needs_extra

if TYPE_CHECKING:
    from distributed import Client

_CONNECTS_WITHIN_S = 10.0  # as long as a scheduler may be away later (`workers._SCHEDULER_S`)
_ALLOWED = "distributed.scheduler.allowed-failures"
_TLS = "distributed.comm.tls"
_CERTIFICATES = (
    "name certificates: DASK_DISTRIBUTED__COMM__TLS__CA_FILE, DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and "
    "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY (docs/cluster.md)"
)


def scheduler_of(executor: str, *, tls: bool) -> str:
    """Return the address of a scheduler in Dask's form.

    Raises:
        ConfigError: It is not an executor, or on another machine and there are no certificates.
    """
    found = re.fullmatch(r"dask://(\[[0-9A-Fa-f:.]+\]|[\w.-]+):(\d{1,5})", executor)
    if not found:
        raise ConfigError(f"{executor!r} is not an executor", where="--executor", hint="write dask://HOST:PORT")
    address = f"{'tls' if tls else 'tcp'}://{found[1]}:{found[2]}"
    if is_open(address):
        raise ConfigError(f"{executor} is another machine, and there is no TLS", where="--executor", hint=_CERTIFICATES)
    return address


def is_open(address: str) -> bool:
    """Return whether an address of Dask can be reached from other machines, unencrypted."""
    scheme, _, rest = address.partition("://")
    host = rest.rpartition(":")[0].strip("[]")
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    return scheme != "tls" and not local


def connect(executor: str) -> Client:
    """Connect to a cluster.

    Raises:
        ConfigError: It must not be used like this; the message says why, and what to do.
        EnvironmentFaultError: No scheduler answers.
    """
    with needs_extra("distributed", "cluster"):
        import dask.config
        from distributed import Client, Security
    for name in ("distributed", "distributed.client"):  # what matters is reported by our own errors
        logging.getLogger(name).setLevel(logging.CRITICAL)
    tls = bool(dask.config.get(f"{_TLS}.ca-file", None))
    address = scheduler_of(executor, tls=tls)
    try:
        security: Any = Security(require_encryption=True) if tls else None
        options: dict[str, Any] = {"timeout": _CONNECTS_WITHIN_S, "security": security, "set_as_default": False}
        client = Client(address, name="riot", direct_to_workers=False, **options)
    except (OSError, ValueError, TypeError) as error:  # unreachable, or invalid certificates
        hint = "start `dask scheduler` there (docs/cluster.md), or mend the address"
        raise EnvironmentFaultError(
            f"no scheduler answers: {str(error).splitlines()[0] if str(error) else type(error).__name__}",
            where=executor,
            hint=hint if tls else f"{hint}; if it speaks TLS, {_CERTIFICATES}",
        ) from None
    try:
        _check(client, executor)
    except BaseException:
        client.close()
        raise
    return client


def _check(client: Client, executor: str) -> None:
    import dask.config

    own = str(client.scheduler_info()["address"])
    if is_open(own):
        raise ConfigError(
            f"the scheduler listens at {own}, for all machines and without TLS",
            where=executor,
            hint="start it with --host 127.0.0.1, or with certificates (docs/cluster.md)",
        )
    if (allowed := client.run_on_scheduler(dask.config.get, _ALLOWED)) != 0:
        raise ConfigError(
            f"the scheduler itself repeats the trials of dead workers ({_ALLOWED} is {allowed})",
            where=executor,
            hint="start it with DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=0 in its environment: riot repeats them",
        )
