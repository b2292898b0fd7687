"""passloc training: how agents are made and judged."""
