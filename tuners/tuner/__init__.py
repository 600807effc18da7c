"""THE tuner: recording in, gains and trust out; how it is trained, evaluated and saved.

What finds the gains is a method: the two stages, or a reference tuner of `rivals`.  Which plant
it is for never matters here, and nothing here reads logs or draws.
"""
