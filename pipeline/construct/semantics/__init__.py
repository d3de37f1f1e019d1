"""Categories and features registered onto Gaussians from 2D labels, or read from others' files."""
