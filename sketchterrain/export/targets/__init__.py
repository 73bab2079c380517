"""Where a terrain can be taken: one module a target, or a family of plain ones."""
