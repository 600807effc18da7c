"""``yawrate app``: a page on this machine that tunes from dropped logs as ``yawrate tune`` does.

The server, its guard, the logs it was given, and the page.  It turns a form into the command's
options and calls what the command calls; reading, tuning and the report are below it.
"""
