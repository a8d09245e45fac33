"""Reports of nonlinear modal models and of free decays."""
