"""Logs from several hosts into one folder: resumable, and checked by their SHA-256."""
