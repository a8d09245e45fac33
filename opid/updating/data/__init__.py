"""What was measured: backbones and linear modes, their files, their noise, and what is wrong with them."""
