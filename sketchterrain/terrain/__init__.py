"""From a recipe to heights, normals and materials, on the device and on the host."""
