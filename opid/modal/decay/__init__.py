"""A nonlinear mode from free decays: frequency and damping tracked over the amplitude, and the law behind them."""
