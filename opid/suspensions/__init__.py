"""Two runs to parameters: the output-only identification of Iwaniec & Uhl (2007)."""
