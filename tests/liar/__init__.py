"""A liar for the study: functions of the library that are wrong by a little, and cases cut short to be lied to.

`lies.toml` says of every kind which case is run, how it is cut short, and what is wrong in it by how much.
"""
