"""Charts as values, and their two forms: static SVG for print, interactive (uPlot, vendored) on the page."""
