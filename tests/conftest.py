from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("tests", derandomize=True, deadline=None)
settings.load_profile("tests")
