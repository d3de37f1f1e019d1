"""Scene folders written: generated, from scans, labelled, described, indexed."""
