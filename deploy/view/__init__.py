"""Live page on Bokeh's server: movement, delays and losses as they happen, and the network's controls."""
