"""The paper's chain (Iwaniec & Uhl 2007), as printed and mended: a method with a result of its own.

`identification.identify_by_paper` gives a `result.PaperIdentification`; `chain.compute_chain` runs the steps of the
paper with the law of any other fit; `settings.PaperSettings` holds every number that was chosen.
"""
