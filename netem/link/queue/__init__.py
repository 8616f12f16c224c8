"""The bounded queue before a bit rate: what waits, what leaves when, what is dropped."""
