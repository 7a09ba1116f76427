"""What the commands do, for the command line and for Python alike: each takes what the options of
its name take, with the same defaults, and returns its tables.
"""
