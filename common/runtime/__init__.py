"""Effects: clocks, buses, logs and processes. The import contracts name the few modules that may use them."""
