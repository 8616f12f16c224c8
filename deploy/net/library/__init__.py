"""The library of network profiles, and the reference of stages."""
