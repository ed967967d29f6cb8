"""From the images of an absolute encoder to angles: any disc of this kind, simulated or real."""
