"""How good a track or a map is, against truth, relations or itself."""
