"""Five papers on passive localisation from fixed stations, reproduced claim by claim in the environment itself."""
