"""What makes ground from paint: placement, hydrology and drained relief."""
