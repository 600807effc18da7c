"""Re-calibration: follow one car's friction and load from window to window, and its gains.

What single recordings tell is `yawrate_env.vehicle.drive_information`'s; what a trained tuner says
of one is `tuners.tuner`'s.
"""
