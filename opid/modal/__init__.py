"""Nonlinear modal models: modes with amplitude-dependent stiffness and damping, identified one by one (Pacini)."""
