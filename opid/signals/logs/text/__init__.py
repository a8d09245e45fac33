"""What text logs have in common: headers, lines, time stamps and tables of numbers."""
