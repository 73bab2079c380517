"""``python -m sketchterrain.world.local_worker``: a worker of this machine; it ends when its starter does."""

from __future__ import annotations

import asyncio
import os
import sys
from threading import Thread

__all__ = ["main"]

_LOST = 60.0  # s without a scheduler after which it ends
_CONFIG = {"distributed.worker.profile.enabled": False, "distributed.worker.use-file-locking": False}


def main(address: str, name: str, threads: str, folder: str) -> None:
    """Work for a scheduler until that is gone, or standard input is at its end.

    Parameters
    ----------
    address
        Of the scheduler.
    name
        Of this worker.
    threads
        How many tasks it takes at once.
    folder
        Where it may leave files of its own.
    """
    import dask.config

    from sketchterrain.world.quiet import quiet

    Thread(target=_end_with_starter, daemon=True).start()
    with dask.config.set(_CONFIG), quiet():
        asyncio.run(_work(address, name, int(threads), folder))


async def _work(address: str, name: str, threads: int, folder: str) -> None:
    from distributed import Worker

    async with Worker(
        address,
        name=name,
        nthreads=threads,
        memory_limit=None,
        local_directory=folder,
        dashboard=False,
        death_timeout=_LOST,
    ) as worker:
        await worker.finished()


def _end_with_starter() -> None:
    # However the starter ends, the system closes its end of this pipe.
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
