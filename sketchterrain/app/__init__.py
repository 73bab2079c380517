"""Work of the commands: generate, export, render, fly; progress and reports."""
