"""The finite-element structure: matrices affine in their unknown factors, their files, and reductions of them."""
