"""Built-in apartments: generated scenes with known objects, for the demo, tests and ablations."""
