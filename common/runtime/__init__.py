"""Effects: clocks, buses, logs and processes. Only the sides' `__main__` and `deploy` may import from here."""
