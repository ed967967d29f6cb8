"""Where a star or satellite is: catalogue, apparent place, refraction, orbits."""
