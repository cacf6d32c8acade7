"""Backend of pyusb whose devices are simulated cameras."""

from __future__ import annotations

import errno
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

from nvsdata.recording.davis.driver import ENDPOINT, VENDOR
from nvsdata.recording.simulated.camera import SimulatedDavis as Device


class Backend(usb.backend.IBackend):  # type: ignore[misc]
    """Backend of pyusb for simulated cameras; `before` is called with the camera and the name of each call."""

    def __init__(self, *cameras: Device, before: Callable[[Device, str], None] = lambda camera, call: None) -> None:
        self.cameras, self.before = cameras, before

    def _use(self, camera: Device, call: str) -> Device:
        self.before(camera, call)
        if camera.unplugged:
            raise usb.core.USBError("No such device", -4, errno.ENODEV)
        if camera.refusal is not None:
            raise usb.core.USBError("refused", None, camera.refusal)
        return camera

    def enumerate_devices(self) -> Any:
        return [camera for camera in self.cameras if not camera.unplugged]

    def get_device_descriptor(self, dev: Device) -> Any:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=VENDOR,
            idProduct=dev.product,
            bcdDevice=dev.firmware,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3 if dev.serial else 0,
            bNumConfigurations=1,
            address=self.cameras.index(dev) + 1,
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=3,
        )

    def get_configuration_descriptor(self, dev: Device, config: int) -> Any:
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=25,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=200,
            extra_descriptors=b"",
        )

    def get_interface_descriptor(self, dev: Device, intf: int, alt: int, config: int) -> Any:
        if intf or alt:
            raise IndexError("no such interface")
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=1,
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=b"",
        )

    def get_endpoint_descriptor(self, dev: Device, ep: int, intf: int, alt: int, config: int) -> Any:
        if ep:
            raise IndexError("no such endpoint")
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=ENDPOINT,
            bmAttributes=2,
            wMaxPacketSize=dev.packet,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=b"",
        )

    def open_device(self, dev: Device) -> Device:
        return self._use(dev, "open")

    def close_device(self, dev_handle: Device) -> None:
        self.before(dev_handle, "close")

    def get_configuration(self, dev_handle: Device) -> int:
        self._use(dev_handle, "configuration")
        return 1

    def set_configuration(self, dev_handle: Device, config_value: int) -> None:
        self._use(dev_handle, "configuration")

    def claim_interface(self, dev_handle: Device, intf: int) -> None:
        self._use(dev_handle, "claim")

    def release_interface(self, dev_handle: Device, intf: int) -> None:
        self.before(dev_handle, "release")

    def clear_halt(self, dev_handle: Device, ep: int) -> None:
        self._use(dev_handle, "clear_halt")

    def ctrl_transfer(
        self,
        dev_handle: Device,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        camera = self._use(dev_handle, "control")
        if (bmRequestType, bRequest) == (0x80, 6) and wValue >> 8 == 3:
            text = camera.serial.encode("utf-16-le")
            answer = bytes([4, 3, 9, 4]) if wValue == 0x0300 else bytes([len(text) + 2, 3]) + text
            data[: len(answer)] = type(data)("B", answer)
            return len(answer)
        return camera.control(bmRequestType, bRequest, wValue, wIndex, data)

    def bulk_read(self, dev_handle: Device, ep: int, intf: int, buff: Any, timeout: int) -> int:
        return self._use(dev_handle, "read").bulk(buff)
