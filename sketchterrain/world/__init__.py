"""Worlds larger than memory: the ground of a rectangle of any size, written shard by shard, and read back."""
