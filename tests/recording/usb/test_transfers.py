"""Requests that wait in libusb, on a library that isn't there."""

import array
import ctypes
import gc
import weakref
from itertools import islice

import pytest
import usb.core
from usb.backend import libusb1

from nvsdata.recording.usb import transfers
from nvsdata.recording.usb.transfers import CANCELLED, COMPLETED, COUNT, AsyncStream, Disconnected


class Library:
    """As libusb, with packets that come one a call."""

    def __init__(self, packets, last=None):
        self.packets, self.last = list(packets), last
        self.structures, self.pending, self.freed = [], [], 0
        self.most = 0

    def libusb_alloc_transfer(self, packets):
        self.structures.append(libusb1._libusb_transfer())
        return ctypes.pointer(self.structures[-1])

    def libusb_submit_transfer(self, transfer):
        self.pending.append(transfer)
        self.most = max(self.most, len(self.pending))
        return 0

    def libusb_cancel_transfer(self, transfer):
        at = [ctypes.addressof(t.contents) for t in self.pending].index(ctypes.addressof(transfer.contents))
        self._complete(self.pending.pop(at), b"", CANCELLED)

    def libusb_free_transfer(self, transfer):
        self.freed += 1

    def libusb_handle_events_timeout(self, context, span):
        if self.packets:
            self._complete(self.pending.pop(0), self.packets.pop(0), COMPLETED)
        elif self.last is not None and self.pending:
            self._complete(self.pending.pop(0), b"", self.last)

    def _complete(self, transfer, data, status):
        request = transfer.contents
        ctypes.memmove(request.buffer, data, len(data))
        request.actual_length, request.status = len(data), status
        request.callback(transfer)


def queued(library):
    return AsyncStream(library, None, libusb1._libusb_device_handle(), 0x82)


def test_what_comes_is_handed_on_in_order_and_requests_always_wait():
    packets = [bytes([n]) * (n * 7 % 600) for n in range(200)]
    library = Library(packets)
    reader = queued(library)
    assert len(library.pending) == COUNT
    got = b""
    while library.packets:
        got += reader.read(10)
        assert len(library.pending) == COUNT
    assert got == b"".join(packets)
    assert reader.read(10) == b""
    reader.close()
    assert (library.freed, library.pending) == (COUNT, [])


def test_a_device_that_goes_is_told_once_all_has_been_read():
    library = Library([b"ab", b"cd"], last=5)
    reader = queued(library)
    got = [reader.read(10) for _ in range(2)]
    assert b"".join(got) == b"abcd"
    # one after the other, the requests end
    assert b"".join(reader.read(10) for _ in range(COUNT)) == b""
    with pytest.raises(Disconnected):
        reader.read(10)
    reader.close()
    assert library.freed == COUNT


def test_requests_that_libusb_still_holds_are_not_freed(monkeypatch):
    monkeypatch.setattr(transfers, "PATIENCE", 0.05)
    library = Library([])
    library.libusb_cancel_transfer = lambda transfer: 0
    reader = queued(library)
    reader.close()
    assert library.freed == 0
    # nor are their buffers
    known = weakref.ref(reader)
    del reader
    gc.collect()
    assert known() in transfers._UNENDED
    transfers._UNENDED.clear()


def test_another_backend_has_no_requests_that_wait():
    class Device:
        backend = object()

    assert transfers.queued(Device(), 0x82) is None


def test_how_long_libusb_may_take():
    """Milliseconds become seconds and microseconds."""
    spans = []
    library = Library([])
    library.libusb_handle_events_timeout = lambda context, span: spans.append(
        (span._obj.seconds, span._obj.microseconds)
    )
    reader = queued(library)
    for timeout in (0, 20, 999, 1_000, 2_345):
        assert reader.read(timeout) == b""
    assert spans == [(0, 0), (0, 20_000), (0, 999_000), (1, 0), (2, 345_000)]


def test_requests_as_libusb_wants_them():
    library = Library([])
    queued(library)
    assert len(library.structures) == 32
    for request in library.structures:
        assert (request.endpoint, request.type, request.timeout, request.length) == (0x82, 2, 0, 65_536)


@pytest.mark.parametrize(
    ("status", "again", "faults"), [(COMPLETED, 1, 0), (2, 1, 0), (CANCELLED, 0, 0), (1, 2, 1), (4, 2, 1)]
)
def test_what_becomes_of_a_request(status, again, faults):
    """By how it ended: done, too late, canceled, failed or stalled; data that came with it is never lost."""
    library = Library([])
    reader = queued(library)
    library._complete(library.pending.pop(0), b"abc", status)
    assert len(library.pending) == COUNT - (again != 1)
    assert reader.read(0) == b"abc"
    assert reader.faults == faults
    # one that failed is tried again when nothing waits to be taken
    assert reader.read(0) == b""
    assert len(library.pending) == COUNT - (again == 0)


def test_a_device_that_is_gone_is_not_asked_again():
    library = Library([])
    reader = queued(library)
    library._complete(library.pending.pop(0), b"", 5)
    assert (reader.read(0), len(library.pending)) == (b"", COUNT - 1)


def test_requests_that_libusb_refuses():
    library = Library([])
    library.libusb_submit_transfer = lambda transfer: -4
    with pytest.raises(Disconnected, match="no request is answered any more"):
        queued(library).read(10)


def test_requests_that_libusb_refuses_at_first_are_counted_and_made_up_for():
    library, take = Library([b"abc"]), Library.libusb_submit_transfer
    refused = iter(range(3))
    library.libusb_submit_transfer = lambda transfer: (
        -11 if next(refused, None) is not None else take(library, transfer)
    )
    reader = queued(library)
    assert (len(library.pending), reader.faults) == (COUNT - 3, 3)
    assert reader.read(10) == b"abc"
    assert (len(library.pending), reader.faults) == (COUNT, 3)
    reader.close()
    assert library.freed == COUNT


def test_a_device_whose_requests_go_on_failing_is_gone():
    library = Library([], last=1)
    reader = queued(library)
    reads = iter(lambda: reader.read(0), None)
    with pytest.raises(Disconnected):
        list(islice(reads, 2_000))
    assert reader.faults >= transfers.MOST_FAULTS


def test_messages_of_the_firmware_come_by_another_endpoint():
    library = Library([])
    reader = AsyncStream(library, None, libusb1._libusb_device_handle(), 0x81, 4, 64, transfers.INTERRUPT)
    assert len(library.pending) == 4
    for request in library.structures:
        assert (request.endpoint, request.type, request.length) == (0x81, 3, 64)
    library._complete(library.pending.pop(0), b"\0\1time" + b"hello", COMPLETED)
    assert reader.arrived() == [b"\0\1timehello"]
    assert (reader.arrived(), len(library.pending)) == ([], 4)


def test_one_request_at_a_time():
    answers = [b"abc", b"", usb.core.USBTimeoutError("late"), usb.core.USBError("gone", None, 19)]

    class Device:
        def read(self, endpoint, buffer, timeout):
            assert (endpoint, len(buffer), timeout) == (0x82, 65_536, 30)
            answer = answers.pop(0)
            if isinstance(answer, Exception):
                raise answer
            buffer[: len(answer)] = array.array("B", answer)
            return len(answer)

    stream = transfers.SyncStream(Device(), 0x82)
    assert [stream.read(30) for _ in range(3)] == [b"abc", b"", b""]
    with pytest.raises(Disconnected, match="gone"):
        stream.read(30)
    stream.close()
