"""Flown episodes for other programs: as tables, and as what Stone Soup works with."""
