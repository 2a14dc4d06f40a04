"""One command per file, named by it."""
