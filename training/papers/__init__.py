"""Five papers on passive localisation from fixed stations, reproduced claim by claim with the environment's own code."""
