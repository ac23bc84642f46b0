"""Other odometry, behind the interface of `edvo.Odometry`: `track`, `skip`, `reset`, `trajectory`.

What it needs beyond the base install is imported where it is used.
"""
