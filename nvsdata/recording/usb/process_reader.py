"""Reading of a camera in a separate process, for backends of pyusb that can't queue requests."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from queue import SimpleQueue
from threading import Thread
from typing import Any

import usb.core
import usb.util

from nvsdata.common.processes import end_with_parent
from nvsdata.common.signals import ENDING
from nvsdata.recording.usb.transfers import Disconnected, SyncStream

READY = b""
STARTING = 20.0  # s that the process may take to start
LEAVING = 2.0  # s that the process may take to send the last blocks
GLIMPSE = 50  # ms per read; after each read, the process checks whether it should stop
OURS = "usb.backend."


def can_read_in_subprocess(device: Any) -> bool:
    """Return True if another process can find the same device, which requires one of pyusb's own backends."""
    return type(device.backend).__module__.startswith(OURS)


class SubprocessStream:
    """Stream of a camera, read by another process; a `UsbStream`.

    Args:
        opener: Function that returns the device with its interface claimed. It is called in that process, so it must be
            picklable.
        endpoint: Endpoint to read from.
        freed: Function that is called when that process has ended (default: none).

    Raises:
        Disconnected: The process can't open the device.
    """

    faults = 0  # a failed request ends the process, so none is counted

    def __init__(self, opener: Callable[[], Any], endpoint: int, freed: Callable[[], None] = lambda: None) -> None:
        context = get_context("spawn")
        self._freed = freed
        self._blocks, theirs = context.Pipe(duplex=False)
        self._stop = context.Event()
        self._process = context.Process(
            target=_serve, args=(opener, endpoint, theirs, self._stop), name="nvsdata-reader", daemon=True
        )
        self._process.start()
        theirs.close()
        try:
            word = self._blocks.recv_bytes() if self._blocks.poll(STARTING) else b"it doesn't start"
        except EOFError:
            word = b"it ended"
        if word != READY:
            self.close()
            raise Disconnected(f"the process that reads the camera failed: {word.decode()}")

    @classmethod
    def of(cls, device: Any, endpoint: int) -> SubprocessStream:
        """Pass a device to another process; this process still does its control transfers."""
        usb.util.release_interface(device, 0)
        opener = partial(_found_again, device.idVendor, device.idProduct, device.bus, device.address)
        return cls(opener, endpoint, partial(usb.util.claim_interface, device, 0))

    def read(self, timeout: int) -> bytes:
        taken = []
        try:
            if self._blocks.poll(timeout / 1000):
                taken.append(self._blocks.recv_bytes())
                while self._blocks.poll(0):
                    taken.append(self._blocks.recv_bytes())
        except (EOFError, OSError):
            if not taken:
                raise Disconnected("the process that reads the camera ended") from None
        return b"".join(taken)

    def close(self) -> None:
        self._stop.set()
        deadline = time.monotonic() + LEAVING
        while time.monotonic() < deadline:
            # blocks that aren't taken keep the process from ending
            try:
                if self._blocks.poll(0.05):
                    self._blocks.recv_bytes()
            except (EOFError, OSError):
                break
        self._blocks.close()
        self._process.join(LEAVING)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._freed()


def _found_again(vendor: int, product: int, bus: int, address: int) -> Any:
    """Return the device that another process has opened before, with its interface claimed."""
    device = usb.core.find(idVendor=vendor, idProduct=product, bus=bus, address=address)
    if device is None:
        raise usb.core.USBError("the camera can't be found again")
    usb.util.claim_interface(device, 0)
    return device


def _serve(opener: Callable[[], Any], endpoint: int, blocks: Connection, stop: Event) -> None:
    """Read until `stop` is set or the device is gone; a second thread sends the bytes to `blocks`."""
    # Ctrl-C, and other signals to a whole terminal or group, are for the process that started this one
    for number in (signal.SIGINT, *ENDING):
        signal.signal(number, signal.SIG_IGN)
    end_with_parent()
    try:
        source = SyncStream(opener(), endpoint)
    except Exception as error:
        blocks.send_bytes(str(error).encode() or b"it failed")
        return
    blocks.send_bytes(READY)
    waiting: SimpleQueue[bytes | None] = SimpleQueue()
    sender = Thread(target=_send, args=(blocks, waiting), daemon=True)
    sender.start()
    try:
        while not stop.is_set():
            if block := source.read(GLIMPSE):
                waiting.put(block)
    except Disconnected:
        pass
    finally:
        waiting.put(None)
        sender.join()
        blocks.close()


def _send(blocks: Connection, waiting: SimpleQueue[bytes | None]) -> None:
    try:
        while (block := waiting.get()) is not None:
            blocks.send_bytes(block)
    except OSError:
        # the other end of the pipe is closed
        return
