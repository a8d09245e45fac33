"""Modal tests of structures with known joints: the structures, the cases of Pacini, and the series of tests."""
