"""Grid maps: cells, tiles, rays, distances, and scans matched against them."""
