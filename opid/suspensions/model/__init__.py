"""The driven body as a function of one vector: the body, its runs, the unknowns, and the prediction errors."""
