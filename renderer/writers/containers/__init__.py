"""Writers of files that hold a whole light field."""
