"""The command line: one module per verb; each loads the kernel only when it needs it."""
