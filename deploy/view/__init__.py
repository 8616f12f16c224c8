"""The live page: movement, delays and losses as they happen, and the network's controls, on Bokeh's server."""
