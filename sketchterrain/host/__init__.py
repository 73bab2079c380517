"""Loops on the host: C sources of ``kernels/host/``, compiled into a shared library and called by `ctypes`."""
