"""Effects in addition to the nominal physics, switched on by the table `[effects]` of a variant file.

Each group of effects is one small file; `plant.effects_table` has their names, parameters and conventions.
"""
