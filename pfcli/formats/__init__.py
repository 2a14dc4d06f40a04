"""Files: one reader or writer each."""
