"""The line to a Dask scheduler, on which nobody waits for ever.

Dask itself does: it waits without a limit for the greeting of whoever accepts its connection, and
for the answers of a scheduler that has stopped.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

from pc2cad.errors import InputError, KernelError

#: seconds that a scheduler has for an answer
SILENCE = 6.0
#: seconds that a cluster object has to start a scheduler
START = 60.0
#: seconds that its workers have to tell their versions: they load packages for it
VERSIONS = 30.0
#: seconds that a client of a lost scheduler has to close
FAREWELL = 1.0


class ClusterLostError(KernelError):
    """The Dask cluster cannot be reached, or has ended."""


class ClusterAddressError(InputError):
    """What stands for a Dask scheduler's address is none."""


def connect(cluster: Any) -> Any:
    """Return a Dask client of a cluster object, or of a scheduler's address.

    Raises ClusterAddressError for what is no address, and ClusterLostError where no scheduler
    answers in time.
    """
    import distributed

    if isinstance(cluster, str):
        _check(cluster)
        _within(SILENCE, cluster, lambda: asyncio.run(_greet(cluster)))
    return _within(
        SILENCE if isinstance(cluster, str) else START,
        cluster,
        lambda: distributed.Client(cluster, timeout=SILENCE, set_as_default=False),
    )


def threads(client: Any) -> int:
    """Return how many threads the workers have; raise OSError where no scheduler answers."""
    found = client.sync(client.scheduler.ncores, workers=None, callback_timeout=SILENCE)
    return sum(found.values())


def versions(client: Any, package: str) -> dict[str, str | None]:
    """Return a package's version by worker, None without it; raise OSError as `threads` does."""
    found = client.sync(
        client._get_versions, check=False, packages=[package], callback_timeout=VERSIONS
    )
    return {at: worker["packages"].get(package) for at, worker in found["workers"].items()}


def close(client: Any, topic: str, lost: bool) -> None:
    """Close a client that has subscribed to a topic."""
    with suppress(OSError, RuntimeError):  # the last: its loop has ended
        if client.status == "running" and not lost:  # the scheduler logs what it cannot deliver
            client.unsubscribe_topic(topic)
        client.close(timeout=FAREWELL if lost else SILENCE)


def _check(address: str) -> None:
    """Raise ClusterAddressError unless this is an address."""
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    try:
        scheme, place = parse_address(address)
        get_backend(scheme)
        if scheme != "inproc":
            parse_host_port(place)
    except ValueError as error:
        raise ClusterAddressError(
            f"--dask: '{address[:200]}' is no address of a Dask scheduler, such as "
            f"tcp://127.0.0.1:8786: {error}"
        ) from error


async def _greet(address: str) -> None:
    """Ask who listens at an address; raise unless it is a scheduler."""
    from distributed import Security
    from distributed.comm import connect

    security = Security().get_connection_args("client")
    line = await connect(address, timeout=SILENCE / 2, **security)
    try:
        await line.write({"op": "identity", "reply": True})
        answer = await line.read()
    finally:
        line.abort()
    kind = answer.get("type") if isinstance(answer, dict) else None
    if kind != "Scheduler":
        raise ClusterAddressError(f"--dask: at {address} is a Dask {kind}, no scheduler")


def _within(seconds: float, cluster: Any, do: Callable[[], Any]) -> Any:
    """Return what a call gives that may hang, or raise in time: it is made in a thread."""
    result: SimpleQueue[Any] = SimpleQueue()

    def make() -> None:
        try:
            result.put(do())
        except Exception as error:
            result.put(error)

    Thread(target=make, daemon=True).start()
    name = cluster if isinstance(cluster, str) else type(cluster).__name__
    try:
        found = result.get(timeout=seconds)
    except Empty:
        raise ClusterLostError(
            f"the Dask cluster {name} cannot be reached: something listens there, but for "
            f"{seconds:g} s it has not answered as a scheduler does"
        ) from None
    match found:
        case InputError():
            raise found
        case Exception():  # what answers may be anything: web pages end in a MemoryError
            raise ClusterLostError(
                f"the Dask cluster {name} cannot be reached: {str(found) or 'no scheduler answers'}"
            ) from found
    return found
