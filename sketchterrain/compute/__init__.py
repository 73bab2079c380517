"""Devices, contexts, programs and buffers. The only room that imports pyopencl."""

from sketchterrain.compute.context import ComputeContext, KernelTime
from sketchterrain.compute.device import Device, choose_device, list_devices, spare_device

__all__ = ["ComputeContext", "Device", "KernelTime", "choose_device", "list_devices", "spare_device"]
