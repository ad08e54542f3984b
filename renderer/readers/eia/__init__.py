"""Pictures that hold all views: elemental image arrays, and mosaics of views side by side."""
