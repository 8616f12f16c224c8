"""The bounded queue of a bit rate: serialisation, tail drop, CoDel."""
