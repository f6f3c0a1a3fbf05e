"""Studies: many variants of one template, planned, run by workers that may die, and resumed.

`plan` says which variants, `local` and `dask` run them, `journal` keeps each result before it is
counted, `table` and `overview` show them.
"""
