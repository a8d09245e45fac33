"""The reported answer: numbers with intervals, what limits them, what is refused and why, and warnings."""
