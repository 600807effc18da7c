"""Gymnasium environments around plants: observe a recorded episode, choose a controller's gains.

Here are the spaces, the scalar and the batch form, the faces of the yaw-rate vehicle and
their pictures.  What learns, and the features that it learns from, belong in `tuners`.
"""
