"""Files, resources, coordinate reference systems and operating-system services."""
