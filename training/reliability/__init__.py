"""What the environment withstands: random scenarios flown for long, and tracks kept although sensors fail."""
