"""The comparison as a self-contained HTML page that pools in the browser what its filters choose."""
