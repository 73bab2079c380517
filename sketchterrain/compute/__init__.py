"""OpenCL devices, contexts, programs and buffers. The only package that imports pyopencl."""

from sketchterrain.compute.context import ComputeContext, KernelTime
from sketchterrain.compute.device import Device, choose_device, fallback_device, list_devices
from sketchterrain.compute.device_check import is_usable

__all__ = [
    "ComputeContext",
    "Device",
    "KernelTime",
    "choose_device",
    "fallback_device",
    "is_usable",
    "list_devices",
]
