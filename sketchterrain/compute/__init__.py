"""OpenCL: devices, contexts, buffers, sharing with OpenGL."""
