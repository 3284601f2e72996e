"""Sources of a camera's video (one file, pieces of a recording, or pictures), and the times of these files.

`files` lists a camera's files and places them in time, `name_times` and `file_times` find when each was taken, `frame_times`
reads times of single frames, `recording` joins the files. `passerby.perception.video` reads the result like any video.
"""
