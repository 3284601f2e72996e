"""What a camera's video is made of: one file, pieces of a recording, or pictures; and when each of them was taken.

`files` lists what a scene file names, `name_times` and `picture_times` say when each file was taken, `placing` puts them in a
row, `recording` looks into them and makes one recording of them. `passerby.perception.video` reads it like any video.
"""
