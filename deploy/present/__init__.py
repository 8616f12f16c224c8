"""Presentation of results: tables with five renderers, numbers as text, colours, pages and figures."""
