"""One check for each file: what is wrong with a log, a map, a result."""
