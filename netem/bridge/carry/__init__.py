"""Carriage of TCP connections through the emulator, byte by byte and unread (``tis netem --carry tcp``)."""
