"""The terrain and its pictures, in processes of their own; only `link` knows Qt, and of it only signals."""
