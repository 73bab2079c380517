"""Work of the commands: generate, export, render, fly; what it needs."""
