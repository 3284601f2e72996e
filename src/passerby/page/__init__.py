"""The local web page, `passerby open`: what a person can say in a few clicks, written into the scene file.

    browser --(cookie, Host, Origin)--> security --> app --> session --> scene_edits --> scene.toml, world-points-*.csv
                                                      |         |
                                                      |         +--> work: `python -m passerby calibrate` --> OUT
                                                      +--> pictures (videos), geometry (the rig of OUT)
                                                      +--> plan_routes --> plan_upload --> plan-*.png beside the scene file
                                                                  +--> plan_fit (a draft on the rig), plan_view (files)

The scene file and OUT are all the state there is. `session` reads both and makes one JSON value of them; the browser asks for
it again and again, so that it sees what an editor, a second browser or a calibration has changed. An act carries the version
of the scene file that its browser saw: `scene_edits` makes the new text (tomlkit: comments and order stay), checks it as
`passerby check` would, and writes it whole before the click is acknowledged. Geometry is computed here, never in the browser.
A calibration runs in a process of its own; what it prints lies in `OUT/.page`, where a restarted server finds it again.

The folder of `passerby monitor` has a page of its own, which changes nothing: `monitored` reads the folder and the recordings
that it names, `monitor_app` answers. Both apps share `answers`, `security`, `pictures` and the files of `static`.

Needs the extra `page`; the only room that imports starlette, uvicorn and tomlkit. Imports all rooms but `cli`.
"""
