"""Pictures of an episode while it runs, drawn by pygame, which is imported when the first one is wanted."""
