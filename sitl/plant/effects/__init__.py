"""What a rover may have beyond the nominal physics, switched on by the table `[effects]` of a variant file.

Each group of effects is one small file; `table` has their names, parameters and conventions.
"""
