"""Pictures of a scene and of what a run found in it, for `report`, `render` and `view` alike.

`overlays` lays groups of Gaussians over a picture, `map_frame` and `top_down` look from above, `question` draws views
and groundings, `map_sheet` and `question_files` make them files, `run_scene` reads what a run says of a scene and
`scene_places` finds the scenes of a run. Nothing is imported here: `map_frame` and `scene_places` need none of the
kernels that the others load.
"""
