"""What people look at: pages, pictures, films, overlays."""
