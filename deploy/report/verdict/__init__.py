"""Whether a run is valid, the network faithful, and what applications ask for was given."""
