"""Library of network profiles, and reference of the stages."""
