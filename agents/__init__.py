"""passloc agents: who decides how the observer moves."""
