"""What strangers can reach, checked in one place: names, folders to import from, processes.

`names` is the one check of what a template, an option or a path may be called, and the one escape
of what reaches a terminal; `isolation` keeps every process from importing what lies in the
current folder; `processes` is how work of the kernel is watched and ended.
"""
