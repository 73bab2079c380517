"""Lists and forms beside the pictures, each a small file."""
