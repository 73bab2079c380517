"""Loops on the host: C sources of ``kernels/host/``, compiled into a library and called by `ctypes`."""
