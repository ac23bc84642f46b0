"""Cameras that run now: one file a make, and a registry that opens them by name."""

from edvo.datasets.devices.device import Device
from edvo.datasets.devices.registry import device_kinds, open_device

__all__ = ["Device", "device_kinds", "open_device"]
