"""The page that needs no network."""
