"""Gains of all controllers, and their sampling time, for tests of exports."""

TS = 0.05
VALUES = {"kp": 1.3, "Ki": 0.4, "Ti": 2.1, "Td": 0.4, "Tf": 0.1, "b": 0.4, "T_lead": 0.2,
          "T_lag": 0.9}  # fmt: skip
