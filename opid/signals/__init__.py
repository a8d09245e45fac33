"""What was measured: recordings, their logs, health, motion and spectra."""
