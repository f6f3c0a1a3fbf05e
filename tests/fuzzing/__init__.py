"""Random texts and templates, for hypothesis, for atheris and for long runs by number."""
