"""passloc environments: an observer manoeuvres to localise a moving emitter that it can only hear."""
