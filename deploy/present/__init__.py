"""How results are shown: tables with five renderers, and numbers as text. It knows nothing of what it shows."""
