"""Short scripts to begin with, each run by itself; README.md says what they show."""
