"""Modes held in phase resonance: force appropriation, phase lock, and the interaction of modes that it shows."""
