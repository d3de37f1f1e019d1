"""A scene and what a run found in it, to walk through in a browser.

`splats` makes Gaussians what the browser draws, `stage` puts them, cameras, clusters and groundings into the room,
`panel` is the controls, `server` opens and ends it all. Only `server` loads viser, which is an extra; the others are
handed its server.
"""
