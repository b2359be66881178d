"""Adapters of Drake and Exudyn, further witnesses beside Pinocchio and MuJoCo: an engine needs no place in the library.

`flexlink.engines.ENGINES` names their modules, as it can name those of other packages.
"""
