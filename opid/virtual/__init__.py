"""Tests with known truth: machines that taxi, modal tests and backbones, simulated as their sensors would record them.

Nowhere else is a truth.json written.
"""
