"""The charts of a page: figures of `opid.plots` as JSON that Plotly.js draws, so that a reader can zoom and point."""
