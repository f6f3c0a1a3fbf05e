"""What strangers can reach, checked in one place: names, files, folders, processes.

`names` is the one check of what a template, an option or a path may be called, and the one escape
of what reaches a terminal; `files` reads what somebody names, within a size; `isolation` keeps
every process from importing what lies in the current folder; `processes` is how work of the kernel
is watched and ended.
"""
