"""The paper's chain (Iwaniec & Uhl 2007), as printed and mended."""
