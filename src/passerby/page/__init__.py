"""The local web page, `passerby open`: a user states facts with a few clicks, and the page writes them into the scene file.

    browser --(cookie, Host, Origin)--> security --> app --> session --> scene_edits --> scene.toml, world-points-*.csv
                                                      |         |
                                                      |         +--> work: `python -m passerby calibrate` --> OUT
                                                      +--> pictures (videos), geometry (the rig of OUT)
                                                      +--> plan_pictures (uploads) --> plan-*.png beside the scene file
                                                      +--> plan_acts (a draft on the rig), plan_view, plan_shapes (files)

The scene file and OUT are the whole state. `session` reads both and makes one JSON value of them. The browser polls this value,
so it shows the changes of an editor, a second browser or a calibration. An act carries the version of the scene file that its
browser saw: `scene_edits` makes the new text (tomlkit keeps comments and order), checks it as a scene, and writes it atomically
before the click is acknowledged. Geometry is computed here, never in the browser. A calibration runs in a process of its own;
its output is in `OUT/.page`, where a restarted server finds it again.

The folder of `passerby monitor` has a page of its own, which changes nothing: `monitored` reads the folder and the recordings
that it names, and `app` answers the requests. Both pages share `security`, `pictures` and the files of `static`.

The package needs the extra `page` and is the only one that imports starlette, uvicorn and tomlkit. It imports all other
packages except `cli`.
"""
