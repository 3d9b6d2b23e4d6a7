"""Data into SVG and PNG; imports `data`."""
