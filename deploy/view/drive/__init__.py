"""Driving in the browser: the surgeon's display as a canvas, and a pointer that moves the operator's hand."""
